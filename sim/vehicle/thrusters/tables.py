"""Read the tables `curve` and `dynamics` of a thruster in a vehicle's file."""

from typing import Any

from hil.common.schema import parse_kind


def read_curve(table: Any, where: str) -> Any:
    """Return the record of a thruster's table `curve`. Raises ConfigError."""
    from sim.vehicle.thrusters.curves import CURVES

    return parse_kind(table, CURVES, where)


def read_dynamics(table: Any, where: str) -> Any:
    """Return the record of a thruster's table `dynamics`. Raises ConfigError."""
    from sim.vehicle.thrusters.lags import DYNAMICS

    return parse_kind(table, DYNAMICS, where)
