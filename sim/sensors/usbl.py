"""Acoustic positioning by ultra-short baseline: a station measures the position of the vehicle's beacon."""

from math import sqrt
from typing import Annotated, NamedTuple

from hil.common.schema import Range
from hil.common.vectors import Vector3
from sim.dynamics import State
from sim.environment.seawater.water_column import SOUND_SPEED, WaterColumn
from sim.environment.world import World
from sim.sensors.error import ErrorModel, sensor_random, variance
from sim.sensors.extra_samples import PositionSample
from sim.sensors.mounting import Mounting
from sim.sensors.samples import Covariance, Scene
from sim.sensors.surface import submersion
from sim.twins import make_error_bank

Metres = Annotated[float, Range(-1e5, 1e5, "m")]


class UsblModel(NamedTuple):
    """Rate in Hz (0: none), position of the station (m, NED), its reach, and errors of range (m) and direction (rad).

    Reach: Blueprint Subsea SeaTrac X150, 1 km. Errors: in the middle of those in Stonefish's examples, 1 to 5 cm and
    0.05 to 0.5 deg; the rate is our choice. `assumed_speed` (m/s) is the speed of sound with which the station computes
    a range from the travel time; 0: that at the station, as if it is measured there.
    """

    rate: Annotated[float, Range(0.0, 50.0, "Hz")] = 1.0
    station: tuple[Metres, Metres, Metres] = (0.0, 0.0, 1.0)
    max_range: Annotated[float, Range(1.0, 20_000.0, "m")] = 1000.0
    range: ErrorModel = ErrorModel(noise=0.03)
    angle: ErrorModel = ErrorModel(noise=0.005)
    assumed_speed: Annotated[float, Range(0.0, 1800.0, "m/s")] = 0.0

    def validate(self) -> str | None:
        """Return what is wrong with a key, or None."""
        is_too_low = 0.0 < self.assumed_speed < 1300.0
        return (
            f"assumed_speed: {self.assumed_speed:g} m/s is no speed of sound in water: give 1300 to 1800"
            if is_too_low
            else None
        )


class Usbl:
    """One beacon, the mounting's `position`, which a station locates; nothing beyond its reach or out of the water.

    The error of the direction is two small angles across the line of sight. A sample is of the instant when the beacon
    sent. It arrives after the travel time of the sound to the station and the mounting's `latency`, which should
    include the transmission back to the vehicle by modem. If the world's profile bends the rays
    (seawater/sound_rays.py), the range is that of the travel time, the direction that from which the sound arrives, and
    there is no sample in a shadow. Not modelled: echoes, obstacles, the ship's motion.
    """

    Model = UsblModel
    topic = "usbl"

    def __init__(self, model: UsblModel, mounting: Mounting, seed: int, scene: Scene) -> None:
        self._station = model.station
        self._max_range = model.max_range
        self._mounting = mounting
        self._scene = scene
        period = 1.0 / model.rate
        self._period, self._range_errors, self._angle_variance = period, model.range, variance(model.angle, period)
        models = [model.range, model.angle, model.angle]
        self._errors = make_error_bank(models, period, sensor_random(seed, self.topic))
        column = _water_column(scene.world)
        self._rays = column.rays(scene.world.depth) if column else None
        self._speed = column.sound_speed(model.station[2]) if column else SOUND_SPEED  # everywhere, without rays
        self._assumed_speed = model.assumed_speed or self._speed
        self.delay_ns = 0

    def sample(self, time_ns: int, state: State) -> PositionSample | None:
        """Return the measurement of `state`."""
        position = self._mounting.world_position(state)
        x, y, z = [a - b for a, b in zip(position, self._station, strict=True)]
        distance = sqrt(x * x + y * y + z * z)
        has_fix = 0.0 < distance <= self._max_range and submersion(self._scene, time_ns, position) >= 0.0
        apparent, seconds = distance * (self._assumed_speed / self._speed), distance / self._speed
        line = (x / distance, y / distance, z / distance) if distance else (0.0, 0.0, 1.0)
        if self._rays and has_fix:
            level = sqrt(x * x + y * y)
            ray = self._rays.between(level, self._station[2], position[2])
            if ray is None:
                has_fix = False
            else:
                apparent, seconds = ray.time * self._assumed_speed, ray.time
                along = sqrt(max(0.0, 1.0 - ray.departure * ray.departure)) / level if level else 0.0
                line = (x * along, y * along, ray.departure)
        measured, down, starboard = self._errors.measure((apparent, 0.0, 0.0))
        if not has_fix:
            return None
        self.delay_ns = round(seconds * 1e9)
        direction = rotate_direction(line, down, starboard)
        north, east, down = [start + measured * along for start, along in zip(self._station, direction, strict=True)]
        return PositionSample(time_ns, (north, east, down), self._covariance(line, distance))

    def _covariance(self, line: Vector3, distance: float) -> Covariance:
        """Return the covariance of the position in m²: the range's along the line of sight, the angles' across it."""
        along = variance(self._range_errors, self._period, distance)
        return position_covariance(line, along, self._angle_variance * distance * distance)


def position_covariance(line: Vector3, along: float, across: float) -> Covariance:
    """Return the covariance in m² of a position with these variances along and across the unit vector `line`."""
    x, y, z = line
    along -= across
    xy, xz, yz = along * x * y, along * x * z, along * y * z
    return along * x * x + across, xy, xz, xy, along * y * y + across, yz, xz, yz, along * z * z + across


def rotate_direction(line: Vector3, down: float, starboard: float) -> Vector3:
    """Return the unit vector `line` (NED), turned by the small perpendicular angles `down` and `starboard` (rad)."""
    x, y, z = line
    level = sqrt(x * x + y * y)
    # (a, b, 0) is horizontal and perpendicular to `line`; vertically above or below the station any direction is
    a, b = (-y / level, x / level) if level > 1e-9 else (0.0, 1.0)
    x, y, z = x + starboard * a - down * z * b, y + starboard * b + down * z * a, z + down * (x * b - y * a)
    length = sqrt(x * x + y * y + z * z)
    return x / length, y / length, z / length


def _water_column(world: World) -> WaterColumn | None:
    profile = world.ocean.profile if world.ocean else None
    return WaterColumn(profile, world.gravity) if profile else None
