"""Measure step responses: step one axis, hold the others, and compute the figures of the response."""

from math import nan
from statistics import fmean
from typing import Any, NamedTuple

from hil.autonomy.control.controller import VelocityCommand
from hil.tuning.rig import CONTROL_PERIOD_S, START_DEPTH, Moment, Rig
from sim.vehicle.terminal_speed import AxisCapability
from sim.vehicle.vehicle import Vehicle

# Default step sizes (m/s, rad/s, m, rad), and the share of the top speed for a vehicle that is too slow for them.
_SPEED, _HEAVE, _TURN, _DIVE, _ROUND, _TILT, _SHARE = 0.5, 0.3, 0.4, 1.0, 0.8, 0.15, 0.4


class Axis(NamedTuple):
    """An axis: `unit` of its response, number `loop` of the wrench's axis (0 surge .. 5 yaw), duration `seconds`."""

    unit: str
    loop: int
    seconds: float


AXES = {
    "surge": Axis("m/s", 0, 10.0),
    "sway": Axis("m/s", 1, 10.0),
    "heave": Axis("m/s", 2, 10.0),
    "roll": Axis("rad", 3, 10.0),
    "pitch": Axis("rad", 4, 10.0),
    "yaw": Axis("rad/s", 5, 10.0),
    "depth": Axis("m", 2, 20.0),
    "heading": Axis("rad", 5, 20.0),
}


class Conditions(NamedTuple):
    """Flight before a step: `surge` m/s, `depth` m (None: afloat), for `settle` s; responses last `longer` times."""

    surge: float = 0.0
    depth: float | None = START_DEPTH
    settle: float = 4.0
    longer: float = 1.0


REST = Conditions()
AFLOAT = Conditions(depth=None, settle=20.0)


class StepFigures(NamedTuple):
    """Figures of a step response.

    `rise`: time (s) from 10 to 90 %. `overshoot`: share of the step beyond the target. `settling`: time (s) until it
    stays within 5 %. `steady`: mean error of the last quarter, in the axis' unit. A level that is never reached gives
    nan. `cost` (s): integral of the absolute error over the step; lower is better.
    """

    rise: float
    overshoot: float
    settling: float
    steady: float
    cost: float


class Response(NamedTuple):
    """Response to a step of `size` at time 0: `times` (s), and `values` (the axis' unit) relative to the start."""

    axis: str
    size: float
    times: list[float]
    values: list[float]

    def figures(self) -> StepFigures:
        """Return the figures of this response."""
        shares = [value / self.size for value in self.values]
        errors = [abs(share - 1.0) for share in shares]
        last_out = max((number for number, error in enumerate(errors) if error > 0.05), default=-1)
        settled = last_out + 1 < len(errors)
        return StepFigures(
            rise=self._first(shares, 0.9) - self._first(shares, 0.1),
            overshoot=max(0.0, max(shares) - 1.0),
            settling=self.times[last_out + 1] if settled else nan,
            steady=fmean(self.values[-len(self.values) // 4 :]) - self.size,
            cost=sum(errors) * CONTROL_PERIOD_S,
        )

    def _first(self, shares: list[float], level: float) -> float:
        return next((time for time, share in zip(self.times, shares, strict=True) if share >= level), nan)


def step_size(axis: str, capability: AxisCapability) -> float:
    """Return the size of a step along `axis`, in its unit, for a vehicle with this `capability`."""
    fixed = {"depth": _DIVE, "heading": _ROUND, "roll": _TILT, "pitch": _TILT}
    if axis in fixed:
        return fixed[axis]
    most = {"heave": _HEAVE, "yaw": _TURN}.get(axis, _SPEED)
    return min(most, _SHARE * min(capability.speed[0], -capability.speed[1]))


def fly_step(
    name: str,
    vehicle: Vehicle,
    control: dict[str, Any],
    axis: str,
    size: float,
    seed: int = 1,
    at: Conditions = REST,
    **rig: Any,
) -> Response:
    """Return the response of `vehicle` under its `[control]` table to a step of `size` along `axis`.

    Roll and pitch cannot be commanded, so they start at an angle of `size`. With a speed ahead in `at`, the response is
    relative to the mean of the last second before the step. `rig` are further arguments of `Rig`. Raises ConfigError.
    """
    tilt = (size if axis == "roll" else 0.0, size if axis == "pitch" else 0.0)
    flight = Rig(name, vehicle, control, tilt=tilt, seed=seed, depth=at.depth or 0.0, **rig)
    base = step_command(axis, 0.0, at)
    before = [] if axis in ("roll", "pitch") else flight.fly(at.settle, lambda time: base)
    command = step_command(axis, size, at)
    moments = flight.fly(at.longer * AXES[axis].seconds, lambda time: command)
    zero = fmean(_value(axis, size, m) for m in before[-round(1.0 / CONTROL_PERIOD_S) :]) if at.surge else 0.0
    return Response(axis, size, [m.time for m in moments], [_value(axis, size, m) - zero for m in moments])


def step_command(axis: str, size: float, at: Conditions = REST) -> VelocityCommand:
    """Return the command for a step along `axis`; the other axes are held."""
    base = VelocityCommand(surge=at.surge, depth=at.depth, heading=0.0)
    return {
        "surge": base._replace(surge=at.surge + size),
        "sway": base._replace(sway=size),
        "heave": base._replace(heave=size, depth=None),
        "yaw": base._replace(yaw_rate=size, heading=None),
        "depth": base._replace(depth=START_DEPTH + size),
        "heading": base._replace(heading=size),
    }.get(axis, base)


def _value(axis: str, size: float, moment: Moment) -> float:
    if axis in ("roll", "pitch"):
        return size - moment.attitude[AXES[axis].loop - 3]
    if axis == "depth":
        return moment.position[2] - START_DEPTH
    return moment.attitude[2] if axis == "heading" else moment.nu[AXES[axis].loop]
