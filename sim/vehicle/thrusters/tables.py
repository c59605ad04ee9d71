"""Read the tables `curve` and `dynamics` of a thruster in a vehicle's file."""

from typing import Any

from hil.common.errors import ConfigError
from hil.common.schema import parse
from sim.vehicle.thrusters.model import Thruster


def with_models(thruster: Thruster, tables: dict[str, Any], where: str) -> Thruster:
    """Return `thruster` with the `curve` and `dynamics` of its TOML table. Raises ConfigError.

    The modules of the models are imported here, because most vehicles do not use them.
    """
    if "curve" in tables:
        from sim.vehicle.thrusters.curves import CURVES

        thruster = thruster._replace(curve=_read_kind(tables["curve"], CURVES, f"{where}: curve"))
    if "dynamics" in tables:
        from sim.vehicle.thrusters.lags import DYNAMICS

        if thruster.time_constant:
            raise ConfigError(f"{where}: give time_constant or dynamics, not both")
        thruster = thruster._replace(dynamics=_read_kind(tables["dynamics"], DYNAMICS, f"{where}: dynamics"))
    return thruster


def _read_kind(table: Any, kinds: dict[str, Any], where: str) -> Any:
    """Return the record that the table's key `kind` selects, made of its other keys."""
    if not isinstance(table, dict):
        raise ConfigError(f'{where}: expected a table like {{ kind = "{next(iter(kinds))}" }}, found {table!r}')
    kind = table.get("kind")
    if not isinstance(kind, str) or kind not in kinds:
        raise ConfigError(f"{where}: kind: {kind!r} is not one of {', '.join(kinds)}")
    return parse({key: value for key, value in table.items() if key != "kind"}, kinds[kind], where)
