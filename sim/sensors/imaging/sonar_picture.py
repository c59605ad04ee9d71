"""Common part of imaging sonars: range errors, noise, gain, and grey levels."""

from typing import Any

import numpy as np

from sim.dynamics import State
from sim.environment.seawater.water_column import SOUND_SPEED, WaterColumn
from sim.sensors.error import ErrorProcess, sensor_random
from sim.sensors.imaging.beam_former import MAX_LOOKS, BeamFormer
from sim.sensors.imaging.echoes import Bins, Echoes, Floats, add_speckle
from sim.sensors.imaging.samples import Encoding
from sim.sensors.mounting import Mounting
from sim.sensors.samples import Scene

_MIN_RANGE = 0.1  # m: at less than this range the gain is constant


class RangeScale:
    """Range errors of a device that measures time and assumes a constant speed of sound.

    `stream` is the name of its random numbers. The true speed of sound is that at the sonar's depth. Not modelled: its
    change along the path.
    """

    def __init__(self, model: Any, mounting: Mounting, seed: int, topic: str, scene: Scene, stream: str = "") -> None:
        self._speed, self._mounting = model.sound_speed, mounting
        ocean = scene.world.ocean
        self._column = WaterColumn(ocean.profile, scene.world.gravity) if ocean and ocean.profile else None
        random = sensor_random(seed, stream or f"{topic}/range")
        self._error = None if model.ground_truth else ErrorProcess(model.error, 1.0 / model.rate, random)

    def measure(self, state: State, *groups: Echoes | None) -> list[Echoes]:
        """Return the echoes at the ranges that the device measures, without the Nones; advance time by one period."""
        present = [echoes for echoes in groups if echoes is not None]
        if self._error is None:
            return present
        true = self._column.sound_speed(self._mounting.depth(state)) if self._column else SOUND_SPEED
        offset = self._error.measure(0.0)
        scale = self._error.numbers()[0] * self._speed / true
        return [echoes.scale_ranges(scale, offset) for echoes in present]


class Picture:
    """Converts mean intensities (echo / source) to grey levels, or to floats with `ground_truth`: see `encoding`.

    `model` is that of an imaging sonar; `solid_angle` (sr) is that of one beam, `pulse` the length of the pulse in
    bins. After a pulse the transducer rings: the level decreases linearly with range from `ringing_level` (dB re the
    source) to that of the noise at `ringing` m. A `former` converts directions to beams.
    """

    def __init__(
        self, model: Any, bins: Bins, solid_angle: float, seed: int, topic: str,
        former: BeamFormer | None = None, pulse: float = 1.0, ringing_level: float = 0.0,
    ) -> None:  # fmt: skip
        self._model, self._former = model, former
        self.encoding: Encoding = "float32" if model.ground_truth else "uint8"
        noise_db = model.noise_level - model.source_level
        self.noise = np.float32(10.0 ** (0.1 * noise_db))
        ringing_db = ringing_level + (noise_db - ringing_level) / max(model.ringing, 1e-3) * bins.middles
        self.ringing: Floats = (10.0 ** (0.1 * ringing_db)).astype(np.float32) * np.float32(model.ringing > 0.0)
        self.random = np.random.Generator(np.random.SFC64(sensor_random(seed, topic).getrandbits(64)))
        ranges = np.maximum(bins.middles, _MIN_RANGE)
        losses = 20.0 * np.log10(ranges) + 2.0 * bins.absorption * ranges
        losses = model.tvg * losses + (1.0 - model.tvg) * np.interp(0.25 * ranges[-1], ranges, losses)
        white_db = model.seabed_strength + 10.0 * np.log10(solid_angle * pulse) - losses - model.gain
        with np.errstate(over="ignore"):  # beyond the reach of the frequency it is limited below
            scale = (10.0 ** (-0.1 * white_db)).astype(np.float32)
        max_scale = np.float32(model.noise_grey ** (2.0 / model.contrast)) / self.noise
        self._scale = np.minimum(scale, max_scale)[:, None]

    def make(self, mean: Floats) -> bytes:
        """Return the picture of mean intensities (bins x directions, or bins x beams without a former), row by row."""
        model, former = self._model, self._former
        mean = mean.astype(np.float32)
        if former and not model.ground_truth and 0.0 < model.looks <= MAX_LOOKS:
            intensities = former.receive_speckled(mean.T, float(self.noise), model.looks, self.random).T
        else:
            received = former.receive(mean.T).T if former else mean
            if model.ground_truth:
                return np.ascontiguousarray(received).tobytes()
            intensities = add_speckle(received + self.noise, model.looks, self.random)
        return self.encode(intensities + self.ringing[:, None])

    def encode(self, intensities: Floats) -> bytes:
        """Return the grey levels of received intensities (bins x beams), row by row."""
        grey = 255.0 * (intensities * self._scale) ** np.float32(0.5 * self._model.contrast)
        picture: bytes = np.minimum(grey, 255.0).astype(np.uint8).tobytes()
        return picture
