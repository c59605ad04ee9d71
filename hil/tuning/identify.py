"""Identify the dynamics of a vehicle's axis: a first-order lag with delay."""

from collections.abc import Sequence
from itertools import accumulate, pairwise
from math import inf
from typing import Any, NamedTuple

from hil.common.errors import ConfigError
from hil.common.vectors import dot
from hil.tuning.rig import CONTROL_PERIOD_S, Rig
from hil.tuning.step_response import REST, Conditions, step_command
from sim.vehicle.vehicle import Vehicle

_PUSH_S, _TILT_S = 3.0, 0.5  # of the evaluated response; later the righting moment of a tilted vehicle dominates
_MIN_POINTS = 8
_DELAY_STEP_S, _DELAY_MOST_S = 0.005, 0.5


class Process(NamedTuple):
    """Model of an axis: v' = `slope` a(t - `delay`) - `damping` v, a the commanded acceleration (force / inertia).

    `slope` is 1 if the vehicle's inertia is known exactly. `damping` in 1/s. `delay` in s includes thruster lag.
    """

    slope: float
    damping: float
    delay: float


def identify_axis(
    name: str,
    vehicle: Vehicle,
    control: dict[str, Any],
    axis: str,
    loop: int,
    force: float,
    inertia: float,
    speed: float,
    at: Conditions = REST,
) -> Process:
    """Return the process of an axis, identified from its response to a step of `force` (N, N m) added to the wrench.

    `loop` is the number of the wrench's axis. The response is evaluated for 3 s (roll and pitch: 0.5 s), or until it
    reaches `speed` (m/s, rad/s). The vehicle's controller holds the other axes meanwhile, in the flight `at` which the
    step begins. `inertia` is the controller's value, kg or kg m².
    Raises ConfigError if it does not move.
    """
    rig = Rig(name, vehicle, control, depth=at.depth or 0.0)
    still = step_command(axis if axis in ("heave", "yaw") else "surge", 0.0, at)
    rig.fly(at.settle, lambda time: still)
    rig.recorder.add_step(loop, force)
    moments = rig.fly(_TILT_S if axis in ("roll", "pitch") else _PUSH_S, lambda time: still)
    values = [moment.nu[loop] - moments[0].nu[loop] for moment in moments]
    end = next((number for number, value in enumerate(values) if abs(value) > speed), len(values))
    return fit_lag(values[: max(end, _MIN_POINTS)], force / inertia, CONTROL_PERIOD_S, f"{name}: {axis}")


def fit_lag(values: Sequence[float], acceleration: float, period: float, where: str) -> Process:
    """Return the process that fits `values` (m/s, rad/s) best, one per `period` s after a step of `acceleration` at 0.

    Integrated once, v = slope a (t - delay) - damping x integral of v is linear in slope and damping: least
    squares for each delay on a grid, and the best of these (Söderström & Stoica 1989, "System Identification", on
    least squares for integrated models). Raises ConfigError if nothing moves the right way.
    """
    distances = [0.0, *accumulate(period * (a + b) / 2.0 for a, b in pairwise(values))]
    best, least_error = None, inf
    for number in range(round(_DELAY_MOST_S / _DELAY_STEP_S)):
        delay = number * _DELAY_STEP_S
        ramp = [acceleration * max(0.0, place * period - delay) for place in range(len(values))]
        slope, damping = _two_unknowns(ramp, [-distance for distance in distances], values)
        if damping < 0.0:
            slope, damping = _one_unknown(ramp, values), 0.0
        off = sum(
            (slope * a - damping * distance - value) ** 2
            for a, distance, value in zip(ramp, distances, values, strict=True)
        )
        if off < least_error:
            best, least_error = Process(slope, damping, delay), off
    if best is None or not best.slope > 0.05:
        raise ConfigError(
            f"{where}: does not move in the direction of the force: check its thrusters' directions (uuv-hil vehicle)"
        )
    return best


def _two_unknowns(a: Sequence[float], b: Sequence[float], y: Sequence[float]) -> tuple[float, float]:
    """Return the least-squares solution x1, x2 of x1 a + x2 b = y; x2 is 0 if a and b are nearly parallel."""
    aa, ab, bb, ay, by = dot(a, a), dot(a, b), dot(b, b), dot(a, y), dot(b, y)
    determinant = aa * bb - ab * ab
    if determinant <= 1e-9 * aa * bb:
        return _one_unknown(a, y), 0.0
    return (ay * bb - by * ab) / determinant, (by * aa - ay * ab) / determinant


def _one_unknown(a: Sequence[float], y: Sequence[float]) -> float:
    square = dot(a, a)
    return dot(a, y) / square if square else 0.0
