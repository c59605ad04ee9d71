"""Find gains from step responses: identify each axis, compute gains, test them, and select the best.

The velocity and rate loops are PI, tuned by Skogestad's SIMC rule for a lag with delay (Journal of Process Control 13,
2003). The age of the samples counts as delay. Closed loops with a time constant of one delay, the fastest robust one by
that rule, and slower ones are simulated; the best one is selected. The outer hold loops are P, four times slower than
the inner loop, so that both together are critically damped.
"""

from collections.abc import Callable, Sequence
from math import inf, sin
from typing import Any, NamedTuple

from hil.autonomy.control.allocation import pseudo_inverse
from hil.autonomy.control.controller import AxisGains, Gains, HoldGains, gains_of
from hil.autonomy.control.fin_control import DIVE_BY_PITCH, FinGains
from hil.common.errors import ConfigError
from hil.common.schema import parse
from hil.master.guidance import cruising_speed
from hil.master.manoeuvring import Manoeuvring
from hil.tuning.identify import Process, identify_axis
from hil.tuning.rig import CONTROL_PERIOD_S, DEEP, START_DEPTH
from hil.tuning.step_response import AFLOAT, AXES, REST, Conditions, Response, StepFigures, fly_step, step_size
from sim.sensors.sensor_set import select_sensors
from sim.vehicle.fins import fin_matrix
from sim.vehicle.terminal_speed import AxisCapability, axis_capabilities
from sim.vehicle.thrusters.bank import wrench_matrix
from sim.vehicle.vehicle import Vehicle, displaced_volume, mass_matrix

LOOPS = ("surge", "sway", "heave", "roll_rate", "pitch_rate", "yaw_rate")
_OVERSHOOT = 0.05
_CLOSED = (1.0, 1.5, 2.2, 3.3)  # time constants of the closed loop to try, in delays
_GAIN = 0.97  # gains are changed only if the cost is at least 3 % lower
# Force of an identification: at most _PUSH of the axis' force, and such that the speed is reached in _PUSH_TIME s, or
# in _TILT_TIME s against a righting moment.
_PUSH, _PUSH_TIME, _TILT_TIME = 0.3, 0.8, 0.3
_RATES = (0.3, 0.3)  # speed at which an identification ends: rad/s of yaw or tilt, m/s of depth
_PITCH, _YAW = 4, 5
_BY_FINS = ("surge", "yaw", "depth", "heading")
_UNDER = ("heave", "depth", "roll", "pitch")  # what a vehicle that floats does not control
_LIGHT = 0.03  # buoyancy beyond the weight, as a share of it, from which a vehicle floats
_SLOW_TURN = 0.4  # turn rate at which an identification with fins ends, as a share of the greatest
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

    A vehicle with fins is tuned at its cruising speed, a surface craft afloat. Raises ConfigError for another
    controller than the cascade.
    """

    def __init__(self, name: str, vehicle: Vehicle, control: dict[str, Any], seed: int = 1) -> None:
        family = control.get("family", "cascade")
        if family != "cascade":
            raise ConfigError(f"{name}: control: family is {family!r}; only the cascade's gains can be tuned")
        self._name, self._vehicle, self._seed = name, vehicle, seed
        self.control = dict(control)
        self.gains = gains_of(control, f"{name}: control")
        self._reach = list(axis_capabilities(vehicle, pseudo_inverse(wrench_matrix(vehicle))[0], DEEP.density))
        mass = mass_matrix(vehicle)
        self._inertia = [mass[axis][axis] for axis in range(6)]
        lift = DEEP.gravity * (DEEP.density * displaced_volume(vehicle, DEEP.density) - vehicle.mass)
        most = max(self._reach[2].force[0], _LIGHT * vehicle.mass * DEEP.gravity)
        self._at, self._floats = REST, not vehicle.fins and lift > most
        if self._floats:
            self._at = AFLOAT
        elif vehicle.fins:
            self._at = self._cruise(parse(control.get("fins", {}), FinGains, f"{name}: control.fins"))

    def _cruise(self, fins: FinGains) -> Conditions:
        """Return the flight at the cruising speed; set the reach of surge, heave, pitch and yaw to that there."""
        vehicle, reach, top = self._vehicle, self._reach, self._reach[0].speed[0]
        if not top:
            raise ConfigError(f"{self._name}: no thruster drives it ahead, which a vehicle that steers by fins needs")
        speed = cruising_speed(top, fins)
        able, rows = self.gains._asdict(), fin_matrix(vehicle.fins, DEEP.density)
        for key, axis in (("pitch_rate", _PITCH), ("yaw_rate", _YAW)):
            pairs = zip(rows[axis], vehicle.fins, strict=True)
            moment = sum(abs(push) * min(fin.max_deflection, fin.stall_angle) for push, fin in pairs)
            force = max(speed * speed * moment, reach[axis].force[0], 1e-9)
            reach[axis] = AxisCapability(reach[axis].axis, (force, -force), (inf, -inf))
            able[key] = able[key]._replace(limit=force / self._inertia[axis])
        motion = Manoeuvring(vehicle, Gains(**able), fins, speed, DEEP.density, DEEP.gravity)
        for axis, most in ((0, top - speed), (2, speed * sin(motion.slope())), (_YAW, speed / motion.turn_radius())):
            reach[axis] = reach[axis]._replace(speed=(most, -most))
        return Conditions(speed, START_DEPTH, settle=30.0, longer=4.0)

    def axes(self) -> list[str]:
        """Return the axes that this vehicle's thrusters and fins drive, without depth and tilt of one that floats."""
        if self._vehicle.fins:
            return list(_BY_FINS)
        return [axis for axis in AXES if self._reach[AXES[axis].loop].driven and not (self._floats and axis in _UNDER)]

    def untuned(self) -> str:
        """Return which axes are not tuned and why, as a line of text; "" if all are."""
        left = ", ".join(axis for axis in AXES if axis not in self.axes())
        return f"not tuned: {left}: {self._drivers} do not drive them" if left else ""

    @property
    def _drivers(self) -> str:
        return (
            "it floats, and its thrusters" if self._floats else "its thrusters" + " and fins" * bool(self._vehicle.fins)
        )

    def tune(self, axes: Sequence[str], report: ReportText = lambda text: None) -> list[Tuned]:
        """Tune `axes`, inner loops first; return the result of each, and set `control` and `gains` to the new gains.

        `report` is called with the name of each axis. Raises ConfigError for an axis that the thrusters do not drive.
        """
        for axis in axes:
            if axis not in self.axes():
                raise ConfigError(
                    f"{self._name}: {self._drivers} do not drive {axis}; they drive: {', '.join(self.axes())}"
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
        self.gains = self.gains._replace(**best.gains)  # type: ignore[arg-type]
        self.control |= {key: getattr(self.gains, key)._asdict() for key in best.gains}
        return best

    def _identify(self, axis: str, size: float) -> Process:
        loop = self._loop(axis)
        speed = size if axis == LOOPS[loop] or axis == "yaw" else _RATES[loop < 3]
        if self._at.surge and loop >= 3:
            speed = _SLOW_TURN * self._reach[_YAW].speed[0]
        inertia = self._inertia[loop]
        is_tilted = axis in ("roll", "pitch")
        time = _TILT_TIME if is_tilted else _PUSH_TIME
        force = min(_PUSH * self._force(loop), inertia * speed / time)
        process = identify_axis(self._name, self._vehicle, self.control, axis, loop, force, inertia, speed, self._at)
        if is_tilted:
            process = process._replace(damping=0.0)  # the righting moment slows it, rather than drag
        if self._at.surge and loop >= 3:  # a servo's lag looks like damping where the hull turns into its path
            process = process._replace(delay=max(process.delay, *(fin.time_constant for fin in self._vehicle.fins)))
        rate = select_sensors()["odometry" if loop < 3 else "imu"].model.rate
        age = 0.5 / float(rate) + 0.5 * CONTROL_PERIOD_S  # of the measurements, on average
        return process._replace(delay=process.delay + age)

    def _loop(self, axis: str) -> int:
        """Return the number of the axis of the wrench (0 surge .. 5 yaw) that leads `axis`."""
        return _PITCH if self._at.surge and axis == "depth" else AXES[axis].loop

    def _propose(self, axis: str, process: Process, closed: float) -> dict[str, AxisGains | HoldGains]:
        """Return gains by key for a closed loop with a time constant of `closed` delays."""
        loop = self._loop(axis)
        time = (closed + 1.0) * process.delay
        proposed: dict[str, AxisGains | HoldGains] = {}
        for key in self._keys(axis):
            present = getattr(self.gains, key)
            if isinstance(present, HoldGains):
                speeds = (inf, -inf) if loop == _PITCH else self._reach[AXES[key].loop].speed
                p = min(20.0, 1.0 / (4.0 * time)) / (DIVE_BY_PITCH if loop == _PITCH and key == "depth" else 1.0)
                proposed[key] = HoldGains(_short(p), _short(min(present.limit, _HOLD_TOP * min(speeds[0], -speeds[1]))))
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
        if self._loop(axis) == _PITCH:
            return ["pitch_rate", "pitch", "depth"]
        return [axis if axis in Gains._fields else "yaw_rate"]

    def _fly(self, axis: str, size: float, control: dict[str, Any]) -> Response:
        return fly_step(self._name, self._vehicle, control, axis, size, self._seed, self._at)

    def _force(self, loop: int) -> float:
        ahead, astern = self._reach[loop].force
        return min(ahead, -astern)


def _cost(figures: StepFigures) -> float:
    """Return the cost to minimise. It doubles with each 10 % of overshoot beyond the first 5 %."""
    return figures.cost * float(2.0 ** (max(0.0, figures.overshoot - _OVERSHOOT) / 0.1))


def _short(value: float) -> float:
    """Return a gain rounded to three digits, its useful precision."""
    return float(f"{value:.3g}")
