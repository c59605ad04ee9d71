"""A leak detector."""

from typing import Annotated, NamedTuple

from hil.common.schema import Range
from sim.dynamics import State
from sim.sensors.extra_samples import FlagSample
from sim.sensors.mounting import Mounting
from sim.sensors.samples import Scene


class LeakModel(NamedTuple):
    """Rate in Hz (0: none) and when water comes in: `at` s of simulation time, or when the detector has been
    `below` m of depth, whichever is first; never if neither is given.
    """

    rate: Annotated[float, Range(0.0, 100.0, "Hz")] = 1.0
    at: Annotated[float, Range(0.0, 1e9, "s")] | None = None
    below: Annotated[float, Range(0.0, 11_000.0, "m")] | None = None


class Leak:
    """One detector: once wet it stays wet. The depth is checked whenever a sample is due.

    Not modelled: the weight of the water in the hull.
    """

    Model = LeakModel
    topic = "leak"

    def __init__(self, model: LeakModel, mounting: Mounting, seed: int, scene: Scene) -> None:
        self._at_ns = None if model.at is None else round(model.at * 1e9)
        self._below = model.below
        self._mounting = mounting
        self._wet = False

    def sample(self, time_ns: int, state: State) -> FlagSample:
        """Return whether it is wet."""
        if self._at_ns is not None and time_ns >= self._at_ns:
            self._wet = True
        if self._below is not None and self._mounting.depth(state) > self._below:
            self._wet = True
        return FlagSample(time_ns, self._wet)
