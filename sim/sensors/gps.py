"""A satellite receiver, which has a fix while its antenna is out of the water."""

from math import nan
from typing import Annotated, NamedTuple

from hil.common.errors import ConfigError
from hil.common.schema import Range
from sim.dynamics import State
from sim.geodesy import TangentPlane
from sim.sensors.error import ErrorModel, sensor_random, variance
from sim.sensors.extra_samples import FixSample
from sim.sensors.mounting import Mounting
from sim.sensors.samples import Scene
from sim.sensors.surface import submersion
from sim.twins import make_error_bank


class GpsModel(NamedTuple):
    """Rate in Hz (0: none), seconds from surfacing to a fix, and errors of the position in m.

    u-blox MAX-M8Q (data sheet): 1 Hz, a hot start within 1 s, half of all fixes within 2.5 m: 2.1 m each of
    north and east. That this wanders over minutes under little noise, and that altitude is half as bad again,
    is our choice.
    """

    rate: Annotated[float, Range(0.0, 25.0, "Hz")] = 1.0
    acquisition: Annotated[float, Range(0.0, 600.0, "s")] = 1.0
    horizontal: ErrorModel = ErrorModel(bias=2.1, bias_time=300.0, noise=0.2)
    vertical: ErrorModel = ErrorModel(bias=3.2, bias_time=300.0, noise=0.3)


class Gps:
    """One receiver; the position is that of its antenna, the mounting's `position`.

    It has a fix from `acquisition` s after its antenna has left the water until the antenna is under water again; waves
    are considered. This is checked whenever a sample is due. Raises ConfigError for a world without an `origin`.
    """

    Model = GpsModel
    topic = "gps"

    def __init__(self, model: GpsModel, mounting: Mounting, seed: int, scene: Scene) -> None:
        world = scene.world
        if world.origin is None:
            raise ConfigError(
                f"sensor 'gps': the world {world.name} does not say where on the earth it is: "
                "give it origin = [latitude, longitude] in degrees"
            )
        self._plane = TangentPlane(*world.origin, world.origin_altitude)
        self._mounting = mounting
        self._scene = scene
        self._acquisition_ns = round(model.acquisition * 1e9)
        self._surfaced_ns: int | None = None
        period = 1.0 / model.rate
        self._variances = variance(model.horizontal, period), variance(model.vertical, period)
        models = [model.horizontal, model.horizontal, model.vertical]
        self._errors = make_error_bank(models, period, sensor_random(seed, self.topic))

    def sample(self, time_ns: int, state: State) -> FixSample:
        """Return the measurement of `state`."""
        position = self._mounting.world_position(state)
        measured = self._errors.measure(position)
        if submersion(self._scene, time_ns, position) >= 0.0:
            self._surfaced_ns = None
        elif self._surfaced_ns is None:
            self._surfaced_ns = time_ns
        if self._surfaced_ns is None or time_ns - self._surfaced_ns < self._acquisition_ns:
            return FixSample(time_ns, nan, nan, nan, self._variances, False)
        return FixSample(time_ns, *self._plane.geodetic(measured), self._variances, True)
