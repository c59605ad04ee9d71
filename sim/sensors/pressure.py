"""A pressure sensor, which is how a vehicle knows its depth."""

from collections.abc import Callable
from typing import Annotated, NamedTuple

from hil.schema import Range
from sim.dynamics import State
from sim.rotations import rotate
from sim.sensors.error import ErrorModel, ErrorProcess, sensor_random
from sim.sensors.samples import PRESSURE, PressureSample, period_ns
from sim.vehicle import Point

STANDARD_ATMOSPHERE = 101_325.0


class PressureModel(NamedTuple):
    """Rate in Hz (0: none), place in the vehicle, pressure of the air in Pa, and errors in Pa.

    Noise: the 0.2 mbar resolution of the MS5837-30BA (TE data sheet). Bias: a drift of 1 cm of water within
    minutes, our choice.
    """

    rate: Annotated[float, Range(0.0, 1000.0, "Hz")] = 20.0
    position: Point = (0.0, 0.0, 0.0)
    atmosphere: Annotated[float, Range(5e4, 1.2e5, "Pa")] = STANDARD_ATMOSPHERE
    error: ErrorModel = ErrorModel(bias=100.0, bias_time=300.0, noise=20.0)


class Pressure:
    """One sensor in water of `density` kg/m³ under `gravity` m/s².

    Where density changes with depth, `column` gives the pressure of the water (Pa) at a depth (m) instead.
    Not modelled: waves, stagnation pressure.
    """

    def __init__(
        self,
        model: PressureModel,
        seed: int,
        density: float,
        gravity: float,
        column: Callable[[float], float] | None = None,
    ) -> None:
        self.period_ns = period_ns(model.rate)
        self._model = model
        self._per_metre = density * gravity
        self._column = column
        self._error = ErrorProcess(model.error, 1.0 / model.rate, sensor_random(seed, PRESSURE))

    def sample(self, time_ns: int, state: State) -> PressureSample:
        """The measurement of `state`; in the air that of the air."""
        depth = state.position[2] + rotate(state.quaternion, self._model.position)[2]
        water = self._column(depth) if self._column else self._per_metre * max(0.0, depth)
        return PressureSample(time_ns, self._error.measure(self._model.atmosphere + water))
