"""Frames of autopilots: they map each motor to a thruster of the vehicle and to its direction of rotation.

A frame is a file in hil/autopilots/frames, with one row per motor: its share of roll, pitch, yaw, throttle, forward and
lateral. A motor is mapped to the thruster whose force and torque about the body origin have the direction of its row,
or the opposite direction. In the latter case its pulse widths are mirrored about neutral, as MOT_n_DIRECTION = -1 or
swapped wires do on a real vehicle. "custom" has no rows: motor i is the vehicle's channel i.
"""

from collections.abc import Sequence
from math import sqrt
from typing import Annotated, NamedTuple

from hil.autopilots.contract import is_output
from hil.common.errors import ConfigError
from hil.common.schema import Range, find_preset, load, preset_names
from hil.links.contract import PWM_NEUTRAL_US
from sim.vehicle.thrusters.bank import wrench_matrix
from sim.vehicle.vehicle import Vehicle

FRAMES = "hil/autopilots/frames"
AUTO, CUSTOM = "auto", "custom"
MIN_COSINE = 0.75  # between a row and a wrench, for force and torque each; 45 degrees are 0.71

Share = Annotated[float, Range(-1.0, 1.0)]
Row = tuple[Share, Share, Share, Share, Share, Share]
AXES = ("ahead", "to the right", "down", "roll right", "bow up", "turn right")
OPPOSITES = ("astern", "to the left", "up", "roll left", "bow down", "turn left")


class Frame(NamedTuple):
    """A frame: `frame_config` is ArduSub's parameter FRAME_CONFIG, `motors` the rows."""

    source: str
    frame_config: Annotated[int, Range(0, 100)]
    motors: tuple[Row, ...]

    def wrenches(self) -> list[tuple[float, ...]]:
        """Return the wrench of each motor, X Y Z K M N along FRD; only its direction has a meaning."""
        return [
            (forward, lateral, -throttle, roll, pitch, yaw)
            for roll, pitch, yaw, throttle, forward, lateral in self.motors
        ]


class Motor(NamedTuple):
    """Mapping of the autopilot's output `output` to the vehicle's channel `channel`, mirrored if `sign` is -1."""

    output: int
    channel: int
    sign: int


class MotorMap:
    """Converter from the outputs of an autopilot to the pulse widths of a vehicle with `channels` channels.

    `frame`: name of the frame. Channels without a motor are neutral.
    """

    def __init__(self, frame: str, motors: Sequence[Motor], channels: int) -> None:
        self.frame = frame
        self.motors = tuple(motors)
        self.neutral = (PWM_NEUTRAL_US,) * channels

    def pulses(self, outputs: Sequence[int]) -> tuple[int, ...]:
        """Return the pulse widths (us) of the vehicle's channels; without output (0 or out of range) neutral."""
        pulses = list(self.neutral)
        for output, channel, sign in self.motors:
            width = outputs[output] if output < len(outputs) else 0
            if is_output(width):
                pulses[channel] = width if sign > 0 else 2 * PWM_NEUTRAL_US - width
        return tuple(pulses)

    def describe(self, vehicle: Vehicle) -> list[str]:
        """Return a line for each motor: its thruster, and where it pushes with a pulse above neutral."""
        columns = list(zip(*wrench_matrix(vehicle, torque=False), strict=True))
        return [
            f"motor {output + 1} ({vehicle.thrusters[channel].name}{', mirrored' if sign < 0 else ''}): "
            + push_text([sign * share for share in columns[channel]])
            for output, channel, sign in self.motors
            if channel < len(columns)  # else a fin or a drop weight
        ]

    def missing(self, outputs: Sequence[int]) -> list[int]:
        """Return the numbers (from 1) of the motors without output."""
        return [m.output + 1 for m in self.motors if m.output >= len(outputs) or not is_output(outputs[m.output])]


def load_frame(name: str) -> Frame:
    """Return the installed frame of this name, or the frame in this file. Raises ConfigError."""
    return load(find_preset(FRAMES, name), Frame)


def map_motors(name: str, vehicle: Vehicle) -> MotorMap:
    """Return the motor map of `vehicle` for the frame `name`; "auto" selects the first frame that matches.

    Raises ConfigError, which names the motor without a matching thruster.
    """
    channels = len(vehicle.channels)
    if name == CUSTOM:
        return MotorMap(CUSTOM, [Motor(i, i, 1) for i in range(channels)], channels)
    if name != AUTO:
        return MotorMap(name, _match(name, load_frame(name), vehicle), channels)
    reasons = []
    for candidate in preset_names(FRAMES):
        try:
            return MotorMap(candidate, _match(candidate, load_frame(candidate), vehicle), channels)
        except ConfigError as error:
            reasons.append(str(error))
    raise ConfigError(
        f"autopilot: frame: no frame matches {vehicle.name}: {'; '.join(reasons)}; give a frame file, or {CUSTOM!r}"
    )


def _match(name: str, frame: Frame, vehicle: Vehicle) -> list[Motor]:
    columns = list(zip(*wrench_matrix(vehicle, torque=False), strict=True))
    if len(columns) != len(frame.motors):
        raise ConfigError(f"frame {name!r} has {len(frame.motors)} motors, {vehicle.name} {len(columns)} thrusters")
    free = set(range(len(columns)))
    motors = []
    for number, row in enumerate(frame.wrenches()):
        best, sign, score = -1, 1, 0.0
        for index in sorted(free):
            similarity = _similarity(row, columns[index])
            if abs(similarity) > score + 1e-9:
                best, sign, score = index, 1 if similarity > 0 else -1, abs(similarity)
        if best < 0:
            raise ConfigError(
                f"frame {name!r}: no thruster of {vehicle.name} pushes like motor {number + 1} ({push_text(row)})"
            )
        free.discard(best)
        motors.append(Motor(number, best, sign))
    return motors


def _similarity(row: Sequence[float], column: Sequence[float]) -> float:
    """Return the similarity of two wrenches: 1 same direction, -1 opposite, 0 if forces and torques do not agree."""
    force, torque = _cosine(row[:3], column[:3]), _cosine(row[3:], column[3:])
    if torque is None or force is None:  # one of the wrenches has no torque or no force, so only the other counts
        only = force if torque is None else torque
        return only if only is not None and abs(only) >= MIN_COSINE else 0.0
    if force * torque <= 0.0 or min(abs(force), abs(torque)) < MIN_COSINE:
        return 0.0
    return 0.5 * (force + torque)


def _cosine(one: Sequence[float], other: Sequence[float]) -> float | None:
    lengths = sqrt(sum(x * x for x in one)), sqrt(sum(x * x for x in other))
    if min(lengths) < 1e-6:
        return None
    return sum(a * b for a, b in zip(one, other, strict=True)) / (lengths[0] * lengths[1])


def push_text(wrench: Sequence[float]) -> str:
    """Return the directions of a wrench as text: components above a fifth of the largest force, or torque."""
    words = []
    for part in (slice(0, 3), slice(3, 6)):
        most = max(abs(x) for x in wrench[part])
        for axis, x in zip(range(6)[part], wrench[part], strict=True):
            if most > 1e-9 and abs(x) > 0.2 * most:
                words.append(AXES[axis] if x > 0 else OPPOSITES[axis])
    return ", ".join(words) or "nowhere"
