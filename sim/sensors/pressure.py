"""A pressure sensor, from which depth is computed."""

from typing import Annotated, NamedTuple

from hil.common.schema import Range
from sim.dynamics import State
from sim.environment.seawater.pressure import ATMOSPHERE_PA
from sim.environment.world import water_pressure
from sim.sensors.error import ErrorModel, sensor_random
from sim.sensors.mounting import Mounting
from sim.sensors.samples import PRESSURE, PressureSample, Scene
from sim.twins import make_error_bank

STANDARD_ATMOSPHERE = ATMOSPHERE_PA


class PressureModel(NamedTuple):
    """Rate in Hz (0: none), pressure of the air in Pa, and errors in Pa.

    Noise: the 0.2 mbar resolution of the MS5837-30BA (TE data sheet). Bias: a drift of 1 cm of water within
    minutes, our choice.
    """

    rate: Annotated[float, Range(0.0, 1000.0, "Hz")] = 20.0
    atmosphere: Annotated[float, Range(5e4, 1.2e5, "Pa")] = ATMOSPHERE_PA
    error: ErrorModel = ErrorModel(bias=100.0, bias_time=300.0, noise=20.0)


class Pressure:
    """A pressure sensor, which also measures the waves above it. Not modelled: stagnation pressure."""

    Model = PressureModel
    topic = PRESSURE

    def __init__(self, model: PressureModel, mounting: Mounting, seed: int, scene: Scene) -> None:
        self._atmosphere = model.atmosphere
        self._mounting = mounting
        self._water = water_pressure(scene.world)
        self._wave_field = scene.wave_field
        self._errors = make_error_bank([model.error], 1.0 / model.rate, sensor_random(seed, self.topic))

    def sample(self, time_ns: int, state: State) -> PressureSample:
        """Return the measurement at `state`; out of the water it is the pressure of the air."""
        if self._wave_field is None:
            depth = self._mounting.depth(state)
        else:
            depth = self._wave_field.pressure_depth(time_ns * 1e-9, *self._mounting.world_position(state))
        (pascal,) = self._errors.measure([self._atmosphere + self._water(depth)])
        return PressureSample(time_ns, pascal)
