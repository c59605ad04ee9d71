"""Find gains from step responses: identify each axis, compute gains, test them, and select the best.

The velocity and rate loops are PI, tuned by Skogestad's SIMC rule for a lag with delay (Journal of Process Control 13,
2003). The age of the samples counts as delay. Closed loops with a time constant of one delay, the fastest robust one by
that rule, and slower ones are simulated; the best one is selected. The outer hold loops are P, four times slower than
the inner loop, so that both together are critically damped.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from hil.autonomy.control.allocation import pseudo_inverse
from hil.autonomy.control.controller import AxisGains, Gains, HoldGains, gains_of
from hil.common.errors import ConfigError
from hil.tuning.identify import Process, identify_axis
from hil.tuning.rig import CONTROL_PERIOD_S
from hil.tuning.step_response import AXES, Response, StepFigures, fly_step, step_size
from sim.sensors.sensor_set import select_sensors
from sim.vehicle.terminal_speed import axis_capabilities
from sim.vehicle.thrusters.bank import wrench_matrix
from sim.vehicle.vehicle import Vehicle, mass_matrix

LOOPS = ("surge", "sway", "heave", "roll_rate", "pitch_rate", "yaw_rate")
_OVERSHOOT = 0.10
_CLOSED = (1.0, 1.5, 2.2, 3.3)  # time constants of the closed loop to try, in delays
_GAIN = 0.97  # gains are changed only if the cost is at least 3 % lower
# Force of an identification: at most _PUSH of the axis' force, and such that the speed is reached in _PUSH_TIME s, or
# in _TILT_TIME s against a righting moment.
_PUSH, _PUSH_TIME, _TILT_TIME = 0.3, 0.8, 0.3
_RATES = (0.3, 0.3)  # speed at which an identification ends: rad/s of yaw or tilt, m/s of depth
_HOLD_TOP = 0.5  # greatest output of a hold loop, as a share of the top speed

ReportText = Callable[[str], None]


class Tuned(NamedTuple):
    """Tuning of one axis: its model, the responses with the old and the new gains, and `gains` by key in [control].

    `better` is False if no proposed gains were better; `gains` are then the old ones.
    """

    axis: str
    process: Process
    before: Response
    after: Response
    gains: dict[str, AxisGains | HoldGains]
    better: bool


class Tuner:
    """Tuner of the gains of `vehicle`, whose file is called `name` and has the `[control]` table `control`.

    Raises ConfigError for a vehicle with fins, or with another controller than the cascade.
    """

    def __init__(self, name: str, vehicle: Vehicle, control: dict[str, Any], seed: int = 1) -> None:
        if vehicle.fins:
            raise ConfigError(
                f"{name}: steers by fins, whose effect depends on speed; only vehicles with thrusters can be tuned"
            )
        family = control.get("family", "cascade")
        if family != "cascade":
            raise ConfigError(f"{name}: control: family is {family!r}; only the cascade's gains can be tuned")
        self._name, self._vehicle, self._seed = name, vehicle, seed
        self.control = dict(control)
        self.gains = gains_of(control, f"{name}: control")
        self._reach = axis_capabilities(vehicle, pseudo_inverse(wrench_matrix(vehicle))[0])
        mass = mass_matrix(vehicle)
        self._inertia = [mass[axis][axis] for axis in range(6)]

    def axes(self) -> list[str]:
        """Return the axes that this vehicle's thrusters drive."""
        return [axis for axis in AXES if self._reach[AXES[axis].loop].driven]

    def tune(self, axes: Sequence[str], report: ReportText = lambda text: None) -> list[Tuned]:
        """Tune `axes`, inner loops first; return the result of each, and set `control` and `gains` to the new gains.

        `report` is called with the name of each axis. Raises ConfigError for an axis that the thrusters do not drive.
        """
        for axis in axes:
            if axis not in self.axes():
                raise ConfigError(
                    f"{self._name}: its thrusters do not drive {axis}; they drive: {', '.join(self.axes())}"
                )
        old = dict(self.control)
        tuned = []
        for axis in (axis for axis in AXES if axis in axes):
            report(axis)
            tuned.append(self._tune_axis(axis, old))
        return tuned

    def _tune_axis(self, axis: str, old: dict[str, Any]) -> Tuned:
        size = step_size(axis, self._reach[AXES[axis].loop])
        process = self._identify(axis, size)
        before = self._fly(axis, size, old)
        present = self._fly(axis, size, self.control)  # the gains of inner loops may have changed
        old_gains = {key: getattr(self.gains, key) for key in self._keys(axis)}
        best = Tuned(axis, process, before, present, old_gains, False)
        least = _GAIN * _cost(present.figures())
        for closed in _CLOSED:
            gains = self._propose(axis, process, closed)
            response = self._fly(axis, size, self.control | {key: row._asdict() for key, row in gains.items()})
            if _cost(response.figures()) < least:
                best, least = Tuned(axis, process, before, response, gains, True), _cost(response.figures())
        self._apply_gains(best.gains)
        return best

    def _identify(self, axis: str, size: float) -> Process:
        loop = AXES[axis].loop
        speed = size if axis == LOOPS[loop] or axis == "yaw" else _RATES[loop < 3]
        inertia = self._inertia[loop]
        time = _TILT_TIME if axis in ("roll", "pitch") else _PUSH_TIME
        force = min(_PUSH * self._force(loop), inertia * speed / time)
        process = identify_axis(self._name, self._vehicle, self.control, axis, force, inertia, speed)
        if axis in ("roll", "pitch"):
            process = process._replace(damping=0.0)  # the righting moment slows it, rather than drag
        return process._replace(delay=process.delay + _sample_age(loop))

    def _propose(self, axis: str, process: Process, closed: float) -> dict[str, AxisGains | HoldGains]:
        """Return gains by key for a closed loop with a time constant of `closed` delays."""
        loop = AXES[axis].loop
        time = (closed + 1.0) * process.delay
        proposed: dict[str, AxisGains | HoldGains] = {}
        for key in self._keys(axis):
            present = getattr(self.gains, key)
            if isinstance(present, HoldGains):
                top = _HOLD_TOP * min(self._reach[loop].speed[0], -self._reach[loop].speed[1])
                proposed[key] = HoldGains(_short(min(20.0, 1.0 / (4.0 * time))), _short(min(present.limit, top)))
            else:
                proposed[key] = present._replace(**self._pi(process, time, self._force(loop) / self._inertia[loop]))
        return proposed

    def _pi(self, process: Process, time: float, most: float) -> dict[str, float]:
        p = min(100.0, 1.0 / (process.slope * time))
        i = min(100.0, p * max(process.damping, 1.0 / (4.0 * time)))
        return {"p": _short(p), "i": _short(i), "limit": _short(min(1e3, most))}

    def _keys(self, axis: str) -> list[str]:
        """Return the keys of the gains that a step along `axis` tests; roll and pitch have no separate rate step."""
        if axis in ("roll", "pitch"):
            return [f"{axis}_rate", axis]
        return [axis if axis in Gains._fields else "yaw_rate"]

    def _fly(self, axis: str, size: float, control: dict[str, Any]) -> Response:
        return fly_step(self._name, self._vehicle, control, axis, size, self._seed)

    def _apply_gains(self, gains: dict[str, AxisGains | HoldGains]) -> None:
        self.gains = self.gains._replace(**gains)  # type: ignore[arg-type]
        self.control |= {key: getattr(self.gains, key)._asdict() for key in gains}

    def _force(self, loop: int) -> float:
        ahead, astern = self._reach[loop].force
        return min(ahead, -astern)


def _sample_age(loop: int) -> float:
    """Return the mean age (s) of the controller's measurements: half a sample and half a control period."""
    rate = select_sensors()["odometry" if loop < 3 else "imu"].model.rate
    return 0.5 / float(rate) + 0.5 * CONTROL_PERIOD_S


def _cost(figures: StepFigures) -> float:
    """Return the cost to minimise. It doubles with each 10 % of overshoot beyond the first 10 %."""
    return figures.cost * float(2.0 ** (max(0.0, figures.overshoot - _OVERSHOOT) / 0.1))


def _short(value: float) -> float:
    """Return a gain rounded to three digits, its useful precision."""
    return float(f"{value:.3g}")
