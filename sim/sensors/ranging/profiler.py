"""A profiling multibeam sonar: distances to the seabed across the track in one ping, and strengths of the echoes."""

from collections.abc import Sequence
from math import cos, inf, log10, nan, sin
from typing import Annotated, NamedTuple

from hil.common.schema import Range
from hil.common.vectors import Vector3
from sim.dynamics import State
from sim.environment.bottom import PROPERTIES
from sim.rays.geometry import NOTHING, SEABED
from sim.sensors.error import ErrorModel, sensor_random
from sim.sensors.mounting import Mounting
from sim.sensors.ranging.beams import cone
from sim.sensors.ranging.fan import DEGREE, Angle, Fan, validate_fan
from sim.sensors.samples import Scene

_MIN_SHARE = 1e-6  # of the intensity of the seabed at normal incidence: strengths are limited to -60 dB relative to it


class ProfilerModel(NamedTuple):
    """Rate in Hz (0: none), number of beams, angles of the first and the last (rad), reach (m), error of the distances.

    A beam is `beam_width` rad wide in both directions and represented by `rings` of rays; with a width of 0 it is one
    ray. `seabed_strength` and `object_strength` are 10 lg mu in dB (see sim.sensors.imaging.echoes). The strength of an
    echo has the speckle of the mean of `looks`; 0 looks: no speckle. With `ground_truth` distances and strengths are
    the true ones. The longest range is the longest setting of the Imagenex 837B in its driver by LSTS (DUNE). The noise
    is the 5 mm of uuv_simulator's sonar beams. The error of the scale is that of an error of 7 m/s in the speed of
    sound. The other defaults are our choice, usual values of such devices.
    """

    rate: Annotated[float, Range(0.0, 100.0, "Hz")] = 5.0
    beams: Annotated[int, Range(2, 10_000)] = 120
    angle_min: Angle = -60.0 * DEGREE
    angle_max: Angle = 60.0 * DEGREE
    beam_width: Annotated[float, Range(0.0, 1.0, "rad")] = 0.0
    rings: Annotated[int, Range(1, 5)] = 1
    min_range: Annotated[float, Range(0.0, 10.0, "m")] = 0.5
    max_range: Annotated[float, Range(0.1, 1000.0, "m")] = 100.0
    seabed_strength: Annotated[float, Range(-80.0, 10.0, "dB")] = -27.0
    object_strength: Annotated[float, Range(-80.0, 10.0, "dB")] = -20.0
    looks: Annotated[float, Range(0.0, 1000.0)] = 4.0
    error: ErrorModel = ErrorModel(noise=0.005, scale=0.005)
    ground_truth: bool = False

    def validate(self) -> str | None:
        """Return what is wrong with the combination of the keys, or None."""
        return validate_fan(self.min_range, self.max_range, self.angle_min, self.angle_max)


class Profiler(Fan):
    """Beams in the sensor's y-z plane. Angles are from z (down) towards y (starboard).

    The distance of a wide beam is the mean distance of its echoes, weighted with their intensities, as by amplitude
    detection. Over a slope, an edge or an object in the water this is neither the nearest distance nor that on the
    beam's axis. Strengths are compensated for spreading and absorption, as real devices do: 10 lg mu + 20 lg of the
    cosine of the angle of incidence (Lambert). That of the seabed depends on the kind of bottom that a `[bottom_map]`
    has there. Not modelled: phase detection, the vehicle's motion during the travel time of the sound, refraction,
    false bottoms.
    """

    Model = ProfilerModel
    topic = "profiler"

    def __init__(self, model: ProfilerModel, mounting: Mounting, seed: int, scene: Scene) -> None:
        super().__init__(model, mounting, seed, scene)
        self._model, self._count = model, len(self.rays(model, 0.0))
        self._random = sensor_random(seed, f"{self.topic}/strength")
        bottom = scene.world.bottom
        self._seabed = 10.0 ** (0.1 * (model.seabed_strength + (PROPERTIES[bottom.kind].echo if bottom else 0.0)))
        self._objects = 10.0 ** (0.1 * model.object_strength)
        self._kinds, self._ratios = scene.world.bottom_map, list[float]()
        if self._kinds:
            from sim.environment.things.bottom_map import echo_ratios

            self._ratios = echo_ratios(bottom)

    @staticmethod
    def rays(model: ProfilerModel, angle: float) -> Sequence[Vector3]:
        """Return the unit vectors of a beam's rays: a cone about its axis, which is `angle` rad from z towards y."""
        width, c, s = model.beam_width, cos(angle), sin(angle)
        directions = cone(width, width, model.rings) if width else [(1.0, 0.0, 0.0)]
        return [(-down, along * s + across * c, along * c - across * s) for along, across, down in directions]

    def measure(self, time_ns: int, state: State) -> tuple[Sequence[float], tuple[float, ...]]:
        """Return the true distance (m) along each beam and the measured strength (dB) of its echo."""
        echoes = self._beams.echoes(time_ns, state)
        model, count = self._model, self._count
        if echoes is None:
            return [inf] * model.beams, (nan,) * model.beams
        hits, cosines = echoes
        intensities = [
            (self._seabed if hit_object == SEABED else self._objects) * cosine * cosine
            if hit_object != NOTHING
            else 0.0
            for hit_object, cosine in zip(hits.objects, cosines, strict=True)
        ]
        if kinds := self._kinds:
            hit_positions = zip(hits.objects, hits.points[0::3], hits.points[1::3], strict=True)
            codes = [
                kinds.code(north, east) if hit_object == SEABED else 0 for hit_object, north, east in hit_positions
            ]
            intensities = [intensity * self._ratios[code] for intensity, code in zip(intensities, codes, strict=True)]
        looks = 0.0 if model.ground_truth else model.looks
        ranges, strengths = [], []
        for first in range(0, len(intensities), count):
            beam_intensities, distances = intensities[first : first + count], hits.distances[first : first + count]
            total = sum(beam_intensities)
            if total <= 0.0:
                ranges.append(inf)
                strengths.append(nan)
                continue
            if count == 1:
                ranges.append(distances[0])
            else:
                ranges.append(sum([s * r for s, r in zip(beam_intensities, distances, strict=True) if s]) / total)
            speckle = self._random.gammavariate(looks, 1.0 / looks) if looks else 1.0
            strengths.append(10.0 * log10(max(total / count * speckle, _MIN_SHARE * self._seabed)))
        return ranges, tuple(strengths)
