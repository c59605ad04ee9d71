"""A side-scan sonar: each ping has one line of echo strengths by slant range for each side."""

from math import inf, pi
from typing import TYPE_CHECKING, Annotated, NamedTuple

from hil.common.schema import Range
from sim.dynamics import State
from sim.sensors.error import ErrorModel
from sim.sensors.imaging.samples import SideScanSample, require_numpy
from sim.sensors.mounting import Mounting
from sim.sensors.samples import Scene

if TYPE_CHECKING:
    from sim.rays.solids import Solid
    from sim.sensors.imaging.echoes import Aperture, Floats

_DEGREE = pi / 180.0
_GRAZING = 0.15  # sine of the angle at which the density of rays is limited


class SideScanModel(NamedTuple):
    """Rate in Hz (0: none), the two beams and their range bins, scattering and noise, and the encoding of the picture.

    A beam is `beam_width` rad wide along the track and `beam_height` rad high across it, at half power, one way; its
    axis is `depression` rad below the horizontal. `slices` x `rays` represent the beam of each side. The other keys are
    those of sim.sensors.imaging.forward_sonar.ForwardSonarModel.

    The defaults are those of a StarFish 450. From its maker: 450 kHz, transducers 30 deg down, beams 60 deg high. A
    beam width of 0.8 deg and a range of 100 m on each side are commonly stated, but we have no source for them. A ping
    needs 133 ms for 100 m and back. Levels, looks, bins and the picture are our choice.
    """

    rate: Annotated[float, Range(0.0, 100.0, "Hz")] = 5.0
    beam_width: Annotated[float, Range(1e-4, pi, "rad")] = 0.8 * _DEGREE
    beam_height: Annotated[float, Range(1e-4, pi, "rad")] = 60.0 * _DEGREE
    depression: Annotated[float, Range(0.0, 0.5 * pi, "rad")] = 30.0 * _DEGREE
    slices: Annotated[int, Range(1, 64)] = 3
    rays: Annotated[int, Range(1, 20_000)] = 1024
    max_range: Annotated[float, Range(0.1, 2000.0, "m")] = 100.0
    range_step: Annotated[float, Range(1e-3, 10.0, "m")] = 0.1
    frequency: Annotated[float, Range(1e4, 5e6, "Hz")] = 450e3
    temperature: Annotated[float, Range(-2.0, 40.0, "°C")] = 10.0
    salinity: Annotated[float, Range(0.0, 45.0)] = 35.0
    sound_speed: Annotated[float, Range(1300.0, 1800.0, "m/s")] = 1500.0
    source_level: Annotated[float, Range(100.0, 250.0, "dB")] = 210.0
    noise_level: Annotated[float, Range(0.0, 200.0, "dB")] = 75.0
    seabed_strength: Annotated[float, Range(-80.0, 10.0, "dB")] = -27.0
    object_strength: Annotated[float, Range(-80.0, 10.0, "dB")] = -20.0
    surface_strength: Annotated[float, Range(-200.0, 10.0, "dB")] = -30.0
    glint: Annotated[float, Range(0.0, 60.0, "dB")] = 0.0
    volume_strength: Annotated[float, Range(-200.0, 0.0, "dB")] = -200.0
    looks: Annotated[float, Range(0.0, 1000.0)] = 2.0
    ringing: Annotated[float, Range(0.0, 10.0, "m")] = 0.5
    error: ErrorModel = ErrorModel(scale=0.005)
    tvg: Annotated[float, Range(0.0, 1.0)] = 1.0
    gain: Annotated[float, Range(-100.0, 100.0, "dB")] = 18.0
    contrast: Annotated[float, Range(0.1, 3.0)] = 0.7
    noise_grey: Annotated[float, Range(0.01, 1.0)] = 0.15
    ground_truth: bool = False


class SideScan:
    """Two beams in the sensor's y-z plane, to port (-y) and to starboard (+y), from above the horizontal to nadir.

    The receiver of the samples makes a picture of successive pings, one line for each ping. Not modelled: refraction,
    Doppler shift, the near field of the array, and echoes of one side that the other side receives.
    """

    Model = SideScanModel
    topic = "side_scan"
    offloaded = True

    def __init__(self, model: SideScanModel, mounting: Mounting, seed: int, scene: Scene) -> None:
        require_numpy(self.topic)
        from sim.sensors.imaging.echoes import Bins, count_bins
        from sim.sensors.imaging.pinger import Pinger
        from sim.sensors.imaging.sonar_picture import Picture, RangeScale

        self._model = model
        aperture = _aperture(model)
        count = count_bins(0.0, model.max_range, model.range_step)
        self._pinger = Pinger(scene, mounting, aperture, model)
        self._bins = Bins(0.0, model.range_step, count, self._pinger.absorption)
        solid_angle = float(aperture.weights.sum()) / 2.0
        self._picture = Picture(model, self._bins, solid_angle, seed, self.topic)
        self._scale = RangeScale(model, mounting, seed, self.topic, scene)

    def add(self, solid: "Solid", state: State) -> None:
        """Add a solid that moves with a vehicle's `state`; its axes are the body's."""
        self._pinger.add(solid, state)

    def sample(self, time_ns: int, state: State) -> SideScanSample:
        """Return the measurement of `state`."""
        import numpy as np

        m = self._model
        sides, altitude = np.zeros((2, self._bins.count)), inf
        for echoes in self._scale.measure(state, self._pinger.ping(time_ns, state)):
            sides = self._pinger.distribute(echoes, self._bins).reshape(2, m.slices, -1).sum(axis=1)
            below = (echoes.energy > 0.0) & (echoes.object != self._pinger.surface)
            nearest = float(echoes.near[below].min(initial=inf))
            altitude = nearest if nearest <= m.max_range else inf
        port, starboard = (self._picture.make(side[:, None]) for side in sides)
        return SideScanSample(
            time_ns, self._bins.count, m.range_step, m.frequency, m.sound_speed, m.beam_width, m.beam_height, altitude,
            self._picture.encoding, port, starboard,
        )  # fmt: skip


def _edges(highest: float, rays: int) -> "Floats":
    """Return the edges of `rays` rays as angles below the horizontal (rad), from `highest` to nadir.

    They are denser at grazing incidence: the edge of a shadow is resolved only to one ray, and the distance between
    neighbouring rays on the seabed grows with the cotangent of the angle.
    """
    import numpy as np

    angles = np.linspace(highest, 0.5 * pi, 20 * rays + 1)
    middles = 0.5 * (angles[1:] + angles[:-1])
    cumulative = np.append(0.0, np.cumsum(1.0 / (np.abs(np.sin(middles)) + _GRAZING)))
    return np.interp(np.linspace(0.0, cumulative[-1], rays + 1), cumulative, angles)


def _aperture(model: SideScanModel) -> "Aperture":
    """Return port's slices, then starboard's, from the upper end of the main lobe, the zenith at most, to nadir."""
    import numpy as np

    from sim.sensors.imaging.echoes import Aperture, beam_pattern, first_null

    lobe = first_null(model.beam_width)
    along_edges = np.linspace(-lobe, lobe, model.slices + 1)
    alongs = 0.5 * (along_edges[1:] + along_edges[:-1])
    highest = model.depression - first_null(model.beam_height)
    edges = _edges(highest, model.rays)
    downs = 0.5 * (edges[1:] + edges[:-1])

    def unit(down: "Floats") -> "Floats":
        side, along, down = np.meshgrid([-1.0, 1.0], alongs, down, indexing="ij")
        vectors = [np.sin(along), side * np.cos(along) * np.cos(down), np.cos(along) * np.sin(down)]
        return np.concatenate(np.stack(vectors, axis=-1))

    across_weights = beam_pattern(downs - model.depression, model.beam_height) ** 2 * np.diff(edges)
    along_weights = beam_pattern(alongs, model.beam_width) ** 2 * (np.sin(along_edges[1:]) - np.sin(along_edges[:-1]))
    weights = np.outer(np.tile(along_weights, 2), across_weights)

    def receiver_pattern(toward: "Floats") -> "Floats":
        down, along = np.arctan2(toward[:, 2], np.abs(toward[:, 1])), np.arcsin(toward[:, 0].clip(-1.0, 1.0))
        return beam_pattern(down - model.depression, model.beam_height) * beam_pattern(along, model.beam_width)

    return Aperture(unit(downs), unit(edges), weights, receiver_pattern=receiver_pattern)
