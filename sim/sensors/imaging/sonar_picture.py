"""Common part of forward-looking and side-scan sonars: range errors, noise, gain, and grey levels."""

from typing import Protocol

import numpy as np

from sim.dynamics import State
from sim.environment.seawater.water_column import SOUND_SPEED, WaterColumn
from sim.sensors.error import ErrorModel, ErrorProcess, sensor_random
from sim.sensors.imaging.beam_former import BeamFormer
from sim.sensors.imaging.echoes import Echoes, Floats, speckled
from sim.sensors.imaging.samples import Encoding
from sim.sensors.mounting import Mounting
from sim.sensors.samples import Scene

_LEAST = 0.1  # m: where the gain with range begins


class _Levels(Protocol):
    """The keys both models have: see sim.sensors.imaging.forward_sonar.ForwardSonarModel."""

    @property
    def rate(self) -> float: ...
    @property
    def sound_speed(self) -> float: ...
    @property
    def source_level(self) -> float: ...
    @property
    def noise_level(self) -> float: ...
    @property
    def seabed_strength(self) -> float: ...
    @property
    def looks(self) -> float: ...
    @property
    def error(self) -> ErrorModel: ...
    @property
    def tvg(self) -> float: ...
    @property
    def gain(self) -> float: ...
    @property
    def contrast(self) -> float: ...
    @property
    def noise_grey(self) -> float: ...
    @property
    def ringing(self) -> float: ...
    @property
    def ground_truth(self) -> bool: ...


def encoding(model: _Levels) -> Encoding:
    """Return the encoding of the picture."""
    return "float32" if model.ground_truth else "uint8"


class RangeScale:
    """Scale of all ranges of a ping by a device that measures time and assumes its own speed of sound.

    `stream` is the name of its random numbers. Not modelled: how the speed changes along the way; that at the sonar
    counts.
    """

    def __init__(
        self, model: _Levels, mounting: Mounting, seed: int, topic: str, scene: Scene, stream: str = ""
    ) -> None:
        self._speed, self._mounting = model.sound_speed, mounting
        ocean = scene.world.ocean
        self._column = WaterColumn(ocean.profile, scene.world.gravity) if ocean and ocean.profile else None
        random = sensor_random(seed, stream or f"{topic}/range")
        self._error = None if model.ground_truth else ErrorProcess(model.error, 1.0 / model.rate, random)

    def measure(self, state: State, *several: Echoes | None) -> list[Echoes]:
        """Return the echoes at the ranges that the device reports; time moves on by one period."""
        found = [echoes for echoes in several if echoes is not None]
        if self._error is None:
            return found
        true = self._column.sound_speed(self._mounting.depth(state)) if self._column else SOUND_SPEED
        offset = self._error.measure(0.0)
        scale = self._error.numbers()[0] * self._speed / true
        return [echoes.moved(scale, offset) for echoes in found]


class Picture:
    """Grey levels out of mean intensities (echo / source), in bins whose middles are `ranges` m, one a row.

    `absorption` dB/m; `solid_angle` (sr) is all that one beam receives, `pulse` how many bins long its pulse is. The
    transducer rings after a pulse: that falls, evenly in dB, from `rings` dB re the source to the noise at `ringing` m.
    A `former` makes beams of directions.
    """

    def __init__(
        self, model: _Levels, ranges: Floats, absorption: float, solid_angle: float, seed: int, topic: str,
        former: BeamFormer | None = None, pulse: float = 1.0, rings: float = 0.0,
    ) -> None:  # fmt: skip
        self._model, self._former = model, former
        quiet = model.noise_level - model.source_level
        self.noise = np.float32(10.0 ** (0.1 * quiet))
        falling = rings + (quiet - rings) / max(model.ringing, 1e-3) * ranges
        self.ringing: Floats = (10.0 ** (0.1 * falling)).astype(np.float32) * np.float32(model.ringing > 0.0)
        self.random = np.random.Generator(np.random.SFC64(sensor_random(seed, topic).getrandbits(64)))
        ranges = np.maximum(ranges, _LEAST)
        losses = 20.0 * np.log10(ranges) + 2.0 * absorption * ranges
        losses = model.tvg * losses + (1.0 - model.tvg) * np.interp(0.25 * ranges[-1], ranges, losses)
        white = model.seabed_strength + 10.0 * np.log10(solid_angle * pulse) - losses - model.gain
        scale = (10.0 ** (-0.1 * white)).astype(np.float32)
        darkest = np.float32(model.noise_grey ** (2.0 / model.contrast)) / self.noise
        self._scale = np.minimum(scale, darkest)[:, None]

    def make(self, mean: Floats) -> bytes:
        """Return the picture, a row a bin, out of mean intensities: of directions, of beams if there is no former."""
        model, former = self._model, self._former
        mean = mean.astype(np.float32)
        if former and not model.ground_truth and former.is_coherent(model.looks):
            found = former.receive_speckled(mean.T, float(self.noise), model.looks, self.random).T
        else:
            received = former.receive(mean.T).T if former else mean
            if model.ground_truth:
                return np.ascontiguousarray(received).tobytes()
            found = speckled(received + self.noise, model.looks, self.random)
        return self.encode(found + self.ringing[:, None])

    def encode(self, intensities: Floats) -> bytes:
        """Return the picture of intensities as they are received, a row a bin."""
        grey = 255.0 * (intensities * self._scale) ** np.float32(0.5 * self._model.contrast)
        made: bytes = np.minimum(grey, 255.0).astype(np.uint8).tobytes()
        return made
