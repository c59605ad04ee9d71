"""Acoustic positioning by ultra-short baseline: a station measures the position of the vehicle's beacon."""

from math import sqrt
from typing import Annotated, NamedTuple

from hil.common.schema import Range
from hil.common.vectors import Vector3
from sim.assembly import make_error_bank
from sim.dynamics import State
from sim.environment.water_column import SOUND_SPEED, WaterColumn
from sim.environment.world import World
from sim.sensors.error import ErrorModel, sensor_random, variance
from sim.sensors.extra_samples import PositionSample
from sim.sensors.mounting import Mounting
from sim.sensors.samples import Covariance, Scene
from sim.sensors.surface import submersion

Metres = Annotated[float, Range(-1e5, 1e5, "m")]


class UsblModel(NamedTuple):
    """Rate in Hz (0: none), where the station is (m, NED), its reach, and errors of range (m) and direction (rad).

    Reach: Blueprint Subsea SeaTrac X150, 1 km. Errors: in the middle of what Stonefish's examples take, 1 to 5 cm and
    0.05 to 0.5 deg; the rate is our choice.
    """

    rate: Annotated[float, Range(0.0, 50.0, "Hz")] = 1.0
    station: tuple[Metres, Metres, Metres] = (0.0, 0.0, 1.0)
    max_range: Annotated[float, Range(1.0, 20_000.0, "m")] = 1000.0
    range: ErrorModel = ErrorModel(noise=0.03)
    angle: ErrorModel = ErrorModel(noise=0.005)


class Usbl:
    """One beacon, the mounting's `position`, which a station locates; nothing beyond its reach or out of the water.

    The direction is wrong by two small angles across the line of sight. A sample is of the instant when the beacon
    sent, and comes after the sound's way to the station and the mounting's `latency`, in which the way back to
    the vehicle by modem belongs. Not modelled: rays that bend, echoes, obstacles in the way, the ship's motion.
    """

    Model = UsblModel
    topic = "usbl"

    def __init__(self, model: UsblModel, mounting: Mounting, seed: int, scene: Scene) -> None:
        self._station = model.station
        self._max_range = model.max_range
        self._mounting = mounting
        self._scene = scene
        period = 1.0 / model.rate
        self._range_variance, self._angle_variance = variance(model.range, period), variance(model.angle, period)
        models = [model.range, model.angle, model.angle]
        self._errors = make_error_bank(models, period, sensor_random(seed, self.topic))
        self._column = _water_column(scene.world)
        self.delay_ns = 0

    def sample(self, time_ns: int, state: State) -> PositionSample | None:
        """Return the measurement of `state`."""
        place = self._mounting.place(state)
        x, y, z = [a - b for a, b in zip(place, self._station, strict=True)]
        distance = sqrt(x * x + y * y + z * z)
        measured, up, starboard = self._errors.measure((distance, 0.0, 0.0))
        if not 0.0 < distance <= self._max_range or submersion(self._scene, time_ns, place) < 0.0:
            return None
        self.delay_ns = round(distance / self._sound_speed(place) * 1e9)
        line = (x / distance, y / distance, z / distance)
        direction = _turned(line, up, starboard)
        north, east, down = [start + measured * along for start, along in zip(self._station, direction, strict=True)]
        return PositionSample(time_ns, (north, east, down), self._covariance(line, distance))

    def _sound_speed(self, place: Vector3) -> float:
        """Half way between station and beacon, in m/s."""
        return self._column.sound_speed(0.5 * (place[2] + self._station[2])) if self._column else SOUND_SPEED

    def _covariance(self, line: Vector3, distance: float) -> Covariance:
        """Return the covariance of the position in m²: the range's along the line of sight, the angles' across it."""
        across = self._angle_variance * distance * distance
        along = self._range_variance - across
        x, y, z = line
        xy, xz, yz = along * x * y, along * x * z, along * y * z
        return along * x * x + across, xy, xz, xy, along * y * y + across, yz, xz, yz, along * z * z + across


def _turned(line: Vector3, up: float, starboard: float) -> Vector3:
    """The unit vector `line` (NED), turned by the small angles `up` and `aside` (rad): both at right angles to it."""
    x, y, z = line
    level = sqrt(x * x + y * y)
    # (a, b, 0) is across and level: straight above or below the station any level direction is
    a, b = (-y / level, x / level) if level > 1e-9 else (0.0, 1.0)
    x, y, z = x + starboard * a - up * z * b, y + starboard * b + up * z * a, z + up * (x * b - y * a)
    length = sqrt(x * x + y * y + z * z)
    return x / length, y / length, z / length


def _water_column(world: World) -> WaterColumn | None:
    profile = world.ocean.profile if world.ocean else None
    return WaterColumn(profile, world.gravity) if profile else None
