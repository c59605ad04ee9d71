"""A forward-looking multibeam sonar: a picture of echo strength by beam and range."""

from math import pi
from typing import TYPE_CHECKING, Annotated, NamedTuple

from hil.common.schema import Range
from sim.dynamics import State
from sim.sensors.error import ErrorModel, sensor_random
from sim.sensors.imaging.samples import SonarImageSample, need_numpy
from sim.sensors.mounting import Mounting
from sim.sensors.samples import Scene

if TYPE_CHECKING:
    from sim.rays.solids import Solid
    from sim.sensors.imaging.echoes import Aperture, Floats

_DEGREE = pi / 180.0


class ForwardSonarModel(NamedTuple):
    """Rate in Hz (0: none), the fan of beams, its range bins, what echoes and disturbs, and how the picture is made.

    `beams` over a `sector` (rad), each `beam_width` by `beam_height` rad at half power, one way; `rays` stand for the
    height of one. `range_step` m is a bin, which is the length of the pulse, compressed. `frequency` Hz gives the
    absorption (Francois & Garrison) in water of `temperature` (deg C) and `salinity` (PSU), and
    `sound_speed` m/s is what the device takes it for. `source_level` is in dB re 1 uPa at 1 m, `noise_level` in dB re
    1 uPa behind the beam former, in the band. `seabed_strength`, `object_strength` and `surface_strength` (the water's
    surface from below) are 10 lg mu in dB; `volume_strength` is that of what drifts in the water, in dB re 1/m: about
    -80 where it is clear, -60 among bubbles or silt. With -200 a strength is none at all. `glint` dB is how much more
    objects send back at a right angle, within some 6 deg of it, than by Lambert's rule; 0 for none. `looks`: see
    sim.sensors.imaging.echoes.speckled. `side_lobes` dB, 0 for none: how far below its own direction a beam receives
    those of its first side lobe; the others fall as those of a line array. `side_lobe_floor` dB, 0 for none, nor
    without side lobes: the same for all other directions, on the average, by errors of the array's elements (see
    sim.sensors.imaging.beam_former). With `multipath` sound comes by way of the surface and the seabed, which take
    `surface_loss` and `bottom_loss` dB of it. `ringing` m, 0 for none: how far the transducer's own ringing after each
    pulse hides echoes; it is white from the first bin on and falls, evenly in dB, to the noise there.
    `error` is that of all ranges.

    The picture: amplitudes to the power of `contrast`; white is the echo of seabed right across a beam, `gain` dB more
    is brighter; `tvg` is the share of the losses by range that the device makes good (1: all). The gain ends where the
    noise alone would be brighter than `noise_grey` (1: white), as limits of devices have it (factor L of Kongsberg's
    M3): farther away the noise stays that dark, and what is not far above it is lost. With `ground_truth` it is the
    mean intensity, echo / source, without noise, speckle and error.

    Defaults: Blueprint Subsea Oculus M750d at 750 kHz (130 x 20 deg, 512 beams of 1 deg, 0.1 to 120 m, 40 Hz at most;
    sources in sim/sensors/devices/oculus_m750d.toml), set to 50 m and bins of 10 cm; levels, looks, losses and the
    picture are our choice. Side lobes: those of a Reson SeaBat 7125 were measured to be below -17 dB (Lanzoni & Weber
    2010, OCEANS). Their floor: errors of 1 dB and 10 deg, our choice, in a line of 102 elements, which has beams of 1
    deg. Pictures of real devices beside: docs/how-to/imaging.md. Seabed: Mackenzie 1961; objects 7 dB more and the
    surface 3 dB less, our choice. Scale: a speed of sound 7 m/s off.
    """

    rate: Annotated[float, Range(0.0, 100.0, "Hz")] = 5.0
    beams: Annotated[int, Range(1, 4096)] = 512
    sector: Annotated[float, Range(1e-3, pi, "rad")] = 130.0 * _DEGREE
    beam_width: Annotated[float, Range(1e-4, pi, "rad")] = 1.0 * _DEGREE
    beam_height: Annotated[float, Range(1e-4, pi, "rad")] = 20.0 * _DEGREE
    rays: Annotated[int, Range(1, 1024)] = 32
    min_range: Annotated[float, Range(0.0, 100.0, "m")] = 0.1
    max_range: Annotated[float, Range(0.1, 1000.0, "m")] = 50.0
    range_step: Annotated[float, Range(1e-3, 10.0, "m")] = 0.1
    frequency: Annotated[float, Range(1e4, 5e6, "Hz")] = 750e3
    temperature: Annotated[float, Range(-2.0, 40.0)] = 10.0
    salinity: Annotated[float, Range(0.0, 45.0)] = 35.0
    sound_speed: Annotated[float, Range(1300.0, 1800.0, "m/s")] = 1500.0
    source_level: Annotated[float, Range(100.0, 250.0)] = 206.0
    noise_level: Annotated[float, Range(0.0, 200.0)] = 68.0
    seabed_strength: Annotated[float, Range(-80.0, 10.0)] = -27.0
    object_strength: Annotated[float, Range(-80.0, 10.0)] = -20.0
    surface_strength: Annotated[float, Range(-200.0, 10.0)] = -30.0
    glint: Annotated[float, Range(0.0, 60.0)] = 0.0
    volume_strength: Annotated[float, Range(-200.0, 0.0)] = -200.0
    looks: Annotated[float, Range(0.0, 1000.0)] = 1.0
    side_lobes: Annotated[float, Range(0.0, 100.0)] = 20.0
    side_lobe_floor: Annotated[float, Range(0.0, 100.0)] = 33.0
    multipath: bool = False
    surface_loss: Annotated[float, Range(0.0, 100.0)] = 3.0
    bottom_loss: Annotated[float, Range(0.0, 100.0)] = 10.0
    ringing: Annotated[float, Range(0.0, 10.0, "m")] = 0.0
    error: ErrorModel = ErrorModel(scale=0.005)
    tvg: Annotated[float, Range(0.0, 1.0)] = 1.0
    gain: Annotated[float, Range(-100.0, 100.0)] = 12.0
    contrast: Annotated[float, Range(0.1, 3.0)] = 0.7
    noise_grey: Annotated[float, Range(0.01, 1.0)] = 0.15
    ground_truth: bool = False

    def validate(self) -> str | None:
        """Return what is wrong with the combination of the keys, or None."""
        return "min_range is not below max_range" if self.min_range >= self.max_range else None


class ForwardSonar:
    """Beams about the sensor's x axis in its x-y plane, each as tall as the beam's main lobe.

    Echoes of the same range and bearing fall on the same place of the picture, at any height, as with a real one. Not
    modelled: what sim.sensors.imaging.echoes leaves out.
    """

    Model = ForwardSonarModel
    topic = "forward_sonar"
    offloaded = True

    def __init__(self, model: ForwardSonarModel, mounting: Mounting, seed: int, scene: Scene) -> None:
        need_numpy(self.topic)
        import numpy as np

        from sim.environment.seawater.absorption import francois_garrison
        from sim.sensors.imaging.beam_former import BeamFormer
        from sim.sensors.imaging.bottom_echo import make_texture
        from sim.sensors.imaging.echoes import Bins, Mirrors, bins_of, pattern
        from sim.sensors.imaging.pinger import Pinger
        from sim.sensors.imaging.sonar_picture import Picture, RangeScale

        self._model, self._mounting = model, mounting
        spacing = model.sector / model.beams
        angles = (np.arange(model.beams) + 0.5) * spacing - 0.5 * model.sector
        self._angles = tuple(angles.tolist())
        aperture = _aperture(model, angles, spacing)
        absorption = francois_garrison(model.frequency, model.temperature, model.salinity)
        count = bins_of(model.min_range, model.max_range, model.range_step)
        self._bins = Bins(model.min_range, model.range_step, count, absorption)
        self._pinger = Pinger(
            scene, mounting, aperture, model.max_range, absorption, model,
            Mirrors(model.surface_loss, model.bottom_loss) if model.multipath else None,
        )  # fmt: skip
        self._texture = make_texture(scene.world)
        self._stride = max(1, round(0.5 * model.beam_width / spacing))
        errors = np.random.default_rng(sensor_random(seed, f"{self.topic}/array").getrandbits(64))
        self._former = BeamFormer(
            model.beams, spacing, model.beam_width, model.side_lobes, model.side_lobe_floor, errors
        )
        lobe = pattern(np.arange(model.beams) * spacing, model.beam_width)
        solid_angle = float(aperture.weights[0].sum() * (2.0 * lobe.sum() - lobe[0]))
        ranges = model.min_range + (np.arange(count) + 0.5) * model.range_step
        self._picture = Picture(model, ranges, absorption, solid_angle, seed, self.topic, self._former)
        self._scale = RangeScale(model, mounting, seed, self.topic, scene)

    def add(self, solid: "Solid", state: State) -> None:
        """Add a solid that moves with a vehicle's `state`; its axes are the body's."""
        self._pinger.add(solid, state)

    def sample(self, time_ns: int, state: State) -> SonarImageSample:
        """Return the measurement of `state`."""
        m = self._model
        from sim.sensors.imaging.sonar_picture import encoding

        made = self._picture.make(self._intensities(time_ns, state).T)
        return SonarImageSample(
            time_ns, self._angles, self._bins.count, m.min_range, m.range_step, m.frequency, m.sound_speed,
            m.beam_width, m.beam_height, encoding(m), made,
        )  # fmt: skip

    def _intensities(self, time_ns: int, state: State) -> "Floats":
        """Return mean echo / source, directions x bins."""
        import numpy as np

        from sim.sensors.imaging.bottom_echo import shares_of
        from sim.sensors.imaging.ping_motion import motion_of

        m = self._model
        scaled = self._scale.measure(state, self._pinger.ping(time_ns, state))
        if not scaled:
            return np.zeros((m.beams, self._bins.count), np.float32)
        echoes = shares_of(scaled[0], self._bins, m.beams, self._texture, self._stride)
        echoes = self._pinger.with_water(echoes, scaled[0], self._bins, m.volume_strength).astype(np.float32)
        if motion := motion_of(state, self._mounting, None):
            echoes = motion.turn_beams(echoes, self._bins, m.sector / m.beams)
        return echoes


def _aperture(model: ForwardSonarModel, angles: "Floats", spacing: float) -> "Aperture":
    """Return a column of rays in the middle of each beam, over the height of the main lobe."""
    import numpy as np

    from sim.rays.splitting import Lattice
    from sim.sensors.imaging.echoes import Aperture, main_lobe, pattern

    lobe = main_lobe(model.beam_height)
    edges = np.linspace(-lobe, lobe, model.rays + 1)
    downs = 0.5 * (edges[1:] + edges[:-1])

    lattice = Lattice(np.linspace(-0.5 * model.sector, 0.5 * model.sector, model.beams + 1), edges)

    def receive(toward: "Floats") -> "Floats":
        return pattern(np.arcsin(toward[:, 2].clip(-1.0, 1.0)), model.beam_height)

    solid_angles = spacing * (np.sin(edges[1:]) - np.sin(edges[:-1]))
    weights = solid_angles * pattern(downs, model.beam_height) ** 2
    middles, parted = (lattice.unit(*np.meshgrid(angles, down, indexing="ij")) for down in (downs, edges))
    weights = np.tile(weights, (model.beams, 1))
    return Aperture(middles, parted, weights, lattice, model.beam_height, receive=receive)
