"""Check a scenario without running it: the content of its files, and errors at its start."""

from collections.abc import Iterator
from contextlib import suppress
from typing import NamedTuple

from hil.autonomy.control.allocation import pseudo_inverse
from hil.common.errors import ConfigError, MissingExtraError, MissionError
from hil.master.flight import prepare
from hil.scenario.attitude_warning import attitude_warning, requested_speed
from hil.scenario.config import AUTOPILOTS, Scenario, build_simulation
from hil.scenario.fleet import as_member
from hil.slave.drivers.ends import check_line_rate, end_protocol
from sim.environment.world import World, load_world
from sim.vehicle.terminal_speed import reaches
from sim.vehicle.thrusters.bank import wrench_matrix
from sim.vehicle.vehicle import Vehicle, load_vehicle


class ScenarioFinding(NamedTuple):
    """One thing about a scenario: `level` is "problem" (no flight succeeds) or "warning", `text` names file and key."""

    level: str
    text: str


def check_scenario(scenario: Scenario) -> Iterator[ScenarioFinding]:
    """Yield what a flight of a loaded scenario would run into; nothing if all is well.

    Raises ConfigError when the vehicle's or the world's file is wrong.
    """
    vehicle, _ = load_vehicle(scenario.vehicle)
    world = load_world(scenario.world)
    attitude = attitude_warning(scenario, vehicle)
    if attitude:
        yield ScenarioFinding("warning", attitude)
    else:
        yield from _check_speed(scenario, vehicle, world)
    if scenario.controller == "builtin":
        yield from _check_line(scenario, vehicle)
    if scenario.member:
        for number, member in enumerate(scenario.member):
            yield from _check_start(as_member(scenario, member.node), vehicle, world, f"member[{number}]")
        return
    yield from _check_start(scenario, vehicle, world, "start")
    if scenario.controller in AUTOPILOTS:  # it flies its own mission
        return
    try:
        prepare(scenario, world)
    except (ConfigError, MissionError) as error:
        text = str(error)
        yield ScenarioFinding("problem", text if scenario.path in text else f"{scenario.path}: {text}")


def _check_speed(scenario: Scenario, vehicle: Vehicle, world: World) -> Iterator[ScenarioFinding]:
    """Compare the speed that is requested with what the thrusters can keep up against the drag."""
    surge = reaches(vehicle, pseudo_inverse(wrench_matrix(vehicle))[0], world.density, world.gravity)[0]
    key, speed = requested_speed(scenario)
    if surge.driven and speed > surge.speed[0]:
        yield ScenarioFinding(
            "warning", f"{scenario.path}: {key}: {speed:g} m/s, but {vehicle.name} reaches {surge.speed[0]:.2f} m/s"
        )


def _check_line(scenario: Scenario, vehicle: Vehicle) -> Iterator[ScenarioFinding]:
    """Find out whether the thruster link can be opened, and whether its line carries the commands."""
    try:
        with suppress(MissingExtraError):  # this machine may not be the one that opens it; the doctor looks there
            end_protocol(scenario.link, "host", len(vehicle.channels))
        check_line_rate(scenario.link, len(vehicle.channels), 1.0 / scenario.slave.control_period)
    except ConfigError as error:
        yield ScenarioFinding("problem", f"{scenario.path}: {error}")


def _check_start(scenario: Scenario, vehicle: Vehicle, world: World, key: str) -> Iterator[ScenarioFinding]:
    """Find out whether the vehicle has room where it starts."""
    try:
        build_simulation(scenario, vehicle, world)
    except ConfigError as error:
        yield ScenarioFinding("problem", f"{scenario.path}: {key}: {error}")
