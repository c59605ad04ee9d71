"""Check sections of a scenario for values that are valid, but with which no flight succeeds."""

import os
from collections.abc import Iterator

from hil.common.errors import NetworkError
from hil.doctor.vehicle.finding import Finding, problem, warning
from hil.network.security import tls
from hil.scenario.config import Scenario
from sim.vehicle.failures import Failure
from sim.vehicle.thrusters.bank import wrench_matrix
from sim.vehicle.vehicle import Vehicle

# Flights of paper_field, path_planning and task_scheduling go too deep with a margin of 0.02 m, but not with this one.
MIN_DEPTH_MARGIN_M = 0.05
# Three of paper_six, bluerov2, bluerov2_heavy, bluerov2_li2020 fail paper_field at 1 Hz, none at 2 Hz (at 0.5 m/s).
MIN_ODOMETRY_HZ = 2.0
HORIZONTAL = 1e-3  # a thruster counts as horizontal from this share of its thrust along x or y


def check_sections(scenario: Scenario, vehicle: Vehicle) -> Iterator[Finding]:
    """Yield findings about [master], [sensors], [[failure]] and [security]."""
    yield from _check_depth_margin(scenario)
    yield from _check_odometry(scenario)
    yield from _check_failures(scenario, vehicle)
    yield from _check_security(scenario)


def _check_depth_margin(scenario: Scenario) -> Iterator[Finding]:
    """Find a depth margin that is smaller than the overshoot of any controller."""
    margin = scenario.master.depth_margin
    if margin < MIN_DEPTH_MARGIN_M and "too_deep" not in scenario.master.allow:
        yield warning(
            f"master: depth_margin: {margin:g} m is less than the overshoot of the depth control, and the run fails as "
            f'too deep: use at least {MIN_DEPTH_MARGIN_M:g} m, or add "too_deep" to allow',
        )


def _check_odometry(scenario: Scenario) -> Iterator[Finding]:
    """Find an odometry rate that is too low for the slave's controller."""
    odometry = scenario.sensors.get("odometry")
    if scenario.controller == "builtin" and odometry and odometry.model.rate < MIN_ODOMETRY_HZ:
        yield warning(
            f"sensors: odometry: rate: {odometry.model.rate:g} Hz is too slow for the controller, which reads speed "
            f"and depth from it: use at least {MIN_ODOMETRY_HZ:g} Hz",
        )


def _check_failures(scenario: Scenario, vehicle: Vehicle) -> Iterator[Finding]:
    """Find a vehicle without horizontal thrust, by its file or by its failures from the start."""
    x, y, *_ = wrench_matrix(vehicle)
    pairs = zip(vehicle.thrusters, x, y, strict=True)
    horizontal = {thruster.name for thruster, *push in pairs if max(map(abs, push)) > HORIZONTAL}
    if max(map(abs, x)) < HORIZONTAL and scenario.master.goal is not None:
        yield problem(
            f"vehicle: {vehicle.name} has no thruster that pushes ahead, so it cannot reach the goal: correct the "
            "directions in its file, or use another vehicle (a glider moves by its buoyancy engine alone)",
        )
    repaired = {one.thruster for one in scenario.failure if one.kind == "repaired"}
    dead = {one.thruster for one in scenario.failure if _is_dead_at_start(one)} - repaired
    if horizontal and horizontal <= dead:
        yield problem(
            f"failure: all horizontal thrusters fail at 0 s ({', '.join(sorted(horizontal))}), so the vehicle cannot "
            "leave its start: remove one failure, or set a later time",
        )


def _is_dead_at_start(failure: Failure) -> bool:
    has_no_thrust = failure.kind == "off" or (failure.kind == "efficiency" and failure.efficiency == 0.0)
    return failure.time == 0.0 and has_no_thrust


def _check_security(scenario: Scenario) -> Iterator[Finding]:
    """Find folders of certificates that do not exist, or lack a file. Each machine needs only its own folder."""
    if scenario.security is None:
        return
    named = {key: getattr(scenario.security, key) for key in ("slave", "master", "router")}
    folders = {key: folder for key, folder in named.items() if folder}
    existing = [key for key, folder in folders.items() if os.path.isdir(folder)]
    for key, folder in folders.items():
        if key in existing:
            try:
                tls(folder)
            except NetworkError as error:
                yield problem(f"security: {key}: {error}")
        elif existing:
            yield warning(
                f"security: {key}: there is no folder {folder}: create it with `uuv-hil keys add NAME`, unless the "
                f"{key} runs on another machine",
            )
        else:
            yield problem(
                f"security: {key}: there is no folder {folder}, nor another folder of [security]: create it with "
                "`uuv-hil keys add NAME`",
            )
