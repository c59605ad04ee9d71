"""What a DVL A50 or A125 measures and computes: its configuration, range modes, reports and dead reckoning.

Source of all figures that are not marked as ours: Water Linked's documentation (github.com/waterlinked/docs, docs/dvl).
"""

import re
from collections.abc import Mapping
from math import cos, degrees, inf, log10, radians, sin, sqrt
from typing import Annotated, Any, Literal, NamedTuple

from hil.common.clock import NS_PER_S
from hil.common.errors import ConfigError
from hil.common.schema import Range, parse, shortened
from hil.common.vectors import Quaternion, Vector3, dot
from sim.rotations import down_axis, from_euler, multiply, rotate, to_euler

TILT = radians(22.5)  # of the beams
# Of transducers 0 to 3 from ahead to starboard, as in the documented report and in drivers of ROS.
AZIMUTHS = [radians(azimuth) for azimuth in (135.0, 225.0, 315.0, 45.0)]
BEAMS = [(sin(TILT) * cos(azimuth), sin(TILT) * sin(azimuth), cos(TILT)) for azimuth in AZIMUTHS]
NO_LOCK_FOM = 2.707  # m/s, as in the documented reports without lock
LEAST_M = 0.05
# Lowest and highest altitude (m) and rate (Hz) of the range modes 0 to 4; the last one reaches as far as the device.
RANGE_MODES = (0.05, 0.6, 15.0), (0.3, 3.0, 10.0), (1.5, 14.0, 5.5), (7.7, 36.0, 7.5), (15.0, inf, 3.0)
SEARCH_HZ = 2.0  # also of tracking the water
NOISE_DBM = -95.0  # ours: spectral density of the noise, and strength of an echo from 1 m
ECHO_DBM = -35.0


# The options of a configuration, in the order of `wcs` and `wrc`.
OPTIONS = (
    "speed_of_sound", "mounting_rotation_offset", "acoustic_enabled", "dark_mode_enabled", "range_mode",
    "periodic_cycling_enabled",
)  # fmt: skip


class DvlSettings(NamedTuple):
    """Settings of a DVL A50 or A125: its configuration when it is new, and its formats.

    `formats` are those of its TCP wires, in their order (default: JSON for all). `serial_protocol` is the number of
    `wcp`: 0 nothing, 1 and 3 lines with and without the old sentences, 2 PD6, 6 PD4. What clients set outlives a loss
    of power, but not the process.
    """

    speed_of_sound: Annotated[float, Range(1000.0, 2000.0, "m/s")] = 1500.0
    mounting_rotation_offset: Annotated[float, Range(0.0, 360.0)] = 0.0
    acoustic_enabled: bool = True
    dark_mode_enabled: bool = False
    range_mode: str = "auto"
    periodic_cycling_enabled: bool = True
    formats: tuple[Literal["json", "pd6", "pd4"], ...] = ()
    serial_protocol: Annotated[int, Range(0, 6)] = 1

    def validate(self) -> str | None:
        """Return why the range mode is invalid, or None."""
        return None if self.is_water or self.modes else "range_mode: expected auto, =a, a<=b or wt"

    def options(self) -> dict[str, Any]:
        """Return what clients read and set."""
        return {name: getattr(self, name) for name in OPTIONS}

    def changed(self, values: Mapping[str, Any]) -> "DvlSettings":
        """Return the settings with other options. Raises ConfigError, which says what the device does not take."""
        if unknown := [name for name in values if name not in OPTIONS]:
            raise ConfigError(f"set_config: no option {shortened(unknown[0])}")
        changed = parse({**self.options(), **values}, DvlSettings, "set_config")
        return changed._replace(formats=self.formats, serial_protocol=self.serial_protocol)

    @property
    def is_water(self) -> bool:
        """Whether it tracks the water instead of the bottom."""
        return self.range_mode == "wt"

    @property
    def modes(self) -> list[int]:
        """The range modes that are permitted; none while it tracks the water."""
        if self.range_mode == "auto":
            return [*range(len(RANGE_MODES))]
        match = re.fullmatch("=([0-4])|([0-4])<=([0-4])", self.range_mode)
        if not match:
            return []
        only, low, high = match.groups()
        return [int(only)] if only else [*range(int(low), int(high) + 1)]

    def follow(self, mode: int | None, altitude: float | None, most: float) -> int | None:
        """Return the range mode at an altitude (m; None: no echo), if it fits the present one; None: it searches.

        The device reaches `most` m.
        """
        limits = [(each, *RANGE_MODES[each]) for each in self.modes]
        fitting = [each for each, low, high, _ in limits if altitude and low <= altitude <= min(high, most)]
        return mode if mode in fitting else next(iter(fitting), None)

    def rate(self, mode: int | None) -> float:
        """Return how often it pings (Hz) in a range mode."""
        return SEARCH_HZ if self.is_water or mode is None else RANGE_MODES[mode][2]


class Transducer(NamedTuple):
    """Speed (m/s) and distance (m) along one beam; 0 and -1 if it has no echo. Strength and noise in dBm."""

    velocity: float = 0.0
    distance: float = -1.0
    rssi: float = NOISE_DBM
    nsd: float = NOISE_DBM
    beam_valid: bool = False


class Report(NamedTuple):
    """One ping, by default without lock. Velocity (m/s) in the vehicle frame, altitude in m, time in us since 1970."""

    milliseconds: float  # since the last one
    velocity: Vector3 = (0.0, 0.0, 0.0)
    variances: Vector3 = (NO_LOCK_FOM**2,) * 3
    altitude: float = -1.0
    transducers: tuple[Transducer, ...] = (Transducer(),) * 4
    is_valid: bool = False
    validity_us: int = 0
    is_water: bool = False

    @property
    def fom(self) -> float:
        """Figure of merit (m/s): the greatest standard deviation of the velocity."""
        return sqrt(max(self.variances)) if self.is_valid else NO_LOCK_FOM

    @property
    def covariance(self) -> list[list[float]]:
        """Rows of the covariance of the velocity ((m/s)²)."""
        return [
            [variance if row == column else 0.0 for column in range(3)] for row, variance in enumerate(self.variances)
        ]


def with_fix(
    report: Report, velocity: Vector3, altitude: float, orientation: Quaternion, noise: float, offset: float
) -> Report:
    """Return a report with the velocity (m/s) and altitude (m, -1 without) along the sensor's axes.

    `orientation` turns those axes into NED: the beams end on a level seabed. `noise` (m/s) is that of one beam,
    `offset` (degrees) that of the mounting. All are as the device computes them, by its own speed of sound.
    """
    down = down_axis(orientation)
    transducers = []
    for beam in BEAMS:
        slope = dot(beam, down)
        distance = altitude / slope if slope > 0.0 and altitude > 0.0 else -1.0
        rssi = ECHO_DBM - 20.0 * log10(max(distance, LEAST_M)) if distance > 0.0 else NOISE_DBM
        transducers.append(Transducer(dot(beam, velocity), distance, rssi, NOISE_DBM, True))
    level = noise**2 / (2.0 * sin(TILT) ** 2)
    return report._replace(
        velocity=rotate(from_euler(0.0, 0.0, radians(offset)), velocity),
        variances=(level, level, noise**2 / (4.0 * cos(TILT) ** 2)),
        altitude=altitude,
        transducers=tuple(transducers),
        is_valid=True,
    )


class DeadReckoning:
    """Position from velocity and attitude, in the vehicle frame at the last reset. The growth of its error is ours."""

    DRIFT = 0.01  # m of standard deviation a metre
    BLIND = 0.2  # m/s of it without velocity

    def __init__(self) -> None:
        self.position: Vector3 = (0.0, 0.0, 0.0)
        self.std = 0.0
        self.angles: Vector3 = (0.0, 0.0, 0.0)  # roll, pitch, yaw in degrees
        self._start: Quaternion | None = None
        self._velocity: Vector3 = (0.0, 0.0, 0.0)
        self._last_ns = 0

    def turn(self, orientation: Quaternion, offset: float) -> None:
        """Take an attitude: of the sensor's axes, NED, with the mounting offset (degrees)."""
        frame = multiply(orientation, from_euler(0.0, 0.0, -radians(offset)))
        if self._start is None:
            self._start = frame
        w, x, y, z = self._start
        self._frame = multiply((w, -x, -y, -z), frame)
        roll, pitch, yaw = to_euler(self._frame)
        self.angles = degrees(roll), degrees(pitch), degrees(yaw)

    def move(self, report: Report, measured_ns: int) -> None:
        """Take a ping; without velocity the last one goes on."""
        seconds = min(2.0, (measured_ns - self._last_ns) / NS_PER_S) if self._last_ns else 0.0
        self._last_ns = measured_ns
        self._velocity = report.velocity if report.is_valid else self._velocity
        if self._start is None:
            return
        step = [speed * seconds for speed in rotate(self._frame, self._velocity)]
        x, y, z = [at + by for at, by in zip(self.position, step, strict=True)]
        self.position = x, y, z
        travelled = sqrt(sum(by * by for by in step))
        self.std += self.DRIFT * travelled if report.is_valid else self.BLIND * seconds
