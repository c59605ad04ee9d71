"""A forward-looking multibeam sonar: a picture of echo strengths by beam and range."""

from math import pi
from typing import TYPE_CHECKING, Annotated, NamedTuple

from hil.common.schema import Range
from sim.dynamics import State
from sim.sensors.error import ErrorModel, sensor_random
from sim.sensors.imaging.samples import SonarImageSample, require_numpy
from sim.sensors.mounting import Mounting
from sim.sensors.samples import Scene

if TYPE_CHECKING:
    from sim.rays.solids import Solid
    from sim.sensors.imaging.echoes import Aperture, Floats

_DEGREE = pi / 180.0


class ForwardSonarModel(NamedTuple):
    """Rate in Hz (0: none), the fan of beams and its range bins, scattering and noise, and the encoding of the picture.

    Beams: `beams` over a `sector` (rad), each `beam_width` by `beam_height` rad at half power, one way. `rays`
    represent the height of a beam. `range_step` (m) is the length of a bin and of the compressed pulse. `side_lobes` is
    the level of a beam's first side lobe below its main lobe (dB; 0: no side lobes); the others decrease like those of
    a line array. `side_lobe_floor` is the mean level of all directions below the main lobe that errors of the array's
    elements add (dB; 0 or no side lobes: none; see sim.sensors.imaging.beam_former).

    Water: `frequency` (Hz) gives the absorption (Francois & Garrison) in water of `temperature` (deg C) and `salinity`
    (PSU). `sound_speed` (m/s) is the speed that the device assumes.

    Levels: `source_level` is in dB re 1 uPa at 1 m, `noise_level` in dB re 1 uPa after the beam former, in the band.
    `seabed_strength`, `object_strength` and `surface_strength` (the water's surface from below) are 10 lg mu in dB.
    `volume_strength` is that of particles in the water in dB re 1/m: about -80 in clear water, -60 among bubbles or
    silt. A strength of -200 means no echo. `glint` is the additional strength of objects at normal incidence, within
    about 6 deg (dB; 0: none). `looks`: see sim.sensors.imaging.echoes.add_speckle.

    Disturbances: `ringing` (m; 0: none) is the range up to which the ringing of the transducer hides echoes: it is
    white in the first bin and decreases linearly in dB to the noise at this range. `error` is that of all ranges.

    Picture: the grey level is the amplitude to the power of `contrast`. White is the echo of seabed at normal
    incidence, less `gain` dB. `tvg` is the share of the losses by range that the device compensates (1: all). The gain
    is limited so that noise alone is not brighter than `noise_grey` (1: white), as in real devices (factor L of
    Kongsberg's M3); echoes that are not well above the noise are lost. With `ground_truth` the picture is the mean
    intensity, echo / source, without noise, speckle and error.

    The defaults are those of a Blueprint Subsea Oculus M750d at 750 kHz: 130 x 20 deg, 512 beams of 1 deg, 0.1 to 120
    m, 40 Hz at most (sources in sim/sensors/devices/oculus_m750d.toml). The range is set to 50 m, with bins of 10 cm.
    The backscatter of the seabed is from Mackenzie 1961. The side lobes of the transmitted beam of a Reson SeaBat 7125
    were measured to be below -17 dB (Lanzoni & Weber 2010, OCEANS). The error of the scale is that of an error of 7 m/s
    in the speed of sound. All other values are our choice: levels, looks and the picture; objects 7 dB above
    the seabed and the surface 3 dB below; the floor of the side lobes, which follows from errors of 1 dB and 10 deg in
    a line of 102 elements with beams of 1 deg. docs/how-to/imaging.md compares the pictures with those of real devices.
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
    temperature: Annotated[float, Range(-2.0, 40.0, "°C")] = 10.0
    salinity: Annotated[float, Range(0.0, 45.0)] = 35.0
    sound_speed: Annotated[float, Range(1300.0, 1800.0, "m/s")] = 1500.0
    source_level: Annotated[float, Range(100.0, 250.0, "dB")] = 206.0
    noise_level: Annotated[float, Range(0.0, 200.0, "dB")] = 68.0
    seabed_strength: Annotated[float, Range(-80.0, 10.0, "dB")] = -27.0
    object_strength: Annotated[float, Range(-80.0, 10.0, "dB")] = -20.0
    surface_strength: Annotated[float, Range(-200.0, 10.0, "dB")] = -30.0
    glint: Annotated[float, Range(0.0, 60.0, "dB")] = 0.0
    volume_strength: Annotated[float, Range(-200.0, 0.0, "dB")] = -200.0
    looks: Annotated[float, Range(0.0, 1000.0)] = 1.0
    side_lobes: Annotated[float, Range(0.0, 100.0, "dB")] = 20.0
    side_lobe_floor: Annotated[float, Range(0.0, 100.0, "dB")] = 33.0
    ringing: Annotated[float, Range(0.0, 10.0, "m")] = 0.0
    error: ErrorModel = ErrorModel(scale=0.005)
    tvg: Annotated[float, Range(0.0, 1.0)] = 1.0
    gain: Annotated[float, Range(-100.0, 100.0, "dB")] = 12.0
    contrast: Annotated[float, Range(0.1, 3.0)] = 0.7
    noise_grey: Annotated[float, Range(0.01, 1.0)] = 0.15
    ground_truth: bool = False

    def validate(self) -> str | None:
        """Return what is wrong with the combination of the keys, or None."""
        return "min_range is not below max_range" if self.min_range >= self.max_range else None


class ForwardSonar:
    """Beams about the sensor's x axis in its x-y plane, each as tall as the beam's main lobe.

    Echoes of the same range and bearing are at the same position in the picture, whatever their height, as with a real
    sonar. Not modelled: refraction, Doppler shift.
    """

    Model = ForwardSonarModel
    topic = "forward_sonar"
    offloaded = True

    def __init__(self, model: ForwardSonarModel, mounting: Mounting, seed: int, scene: Scene) -> None:
        require_numpy(self.topic)
        import numpy as np

        from sim.sensors.imaging.beam_former import BeamFormer
        from sim.sensors.imaging.echoes import Bins, beam_pattern, count_bins
        from sim.sensors.imaging.pinger import Pinger
        from sim.sensors.imaging.sonar_picture import Picture, RangeScale

        self._model, self._mounting = model, mounting
        spacing = model.sector / model.beams
        angles = (np.arange(model.beams) + 0.5) * spacing - 0.5 * model.sector
        self._angles = tuple(angles.tolist())
        aperture = _aperture(model, angles, spacing)
        count = count_bins(model.min_range, model.max_range, model.range_step)
        self._pinger = Pinger(scene, mounting, aperture, model)
        self._bins = Bins(model.min_range, model.range_step, count, self._pinger.absorption)
        self._stride = max(1, round(0.5 * model.beam_width / spacing))
        errors = np.random.default_rng(sensor_random(seed, f"{self.topic}/array").getrandbits(64))
        self._former = BeamFormer(
            model.beams, spacing, model.beam_width, model.side_lobes, model.side_lobe_floor, errors
        )
        lobe = beam_pattern(np.arange(model.beams) * spacing, model.beam_width)
        solid_angle = float(aperture.weights[0].sum() * (2.0 * lobe.sum() - lobe[0]))
        self._picture = Picture(model, self._bins, solid_angle, seed, self.topic, self._former)
        self._scale = RangeScale(model, mounting, seed, self.topic, scene)

    def add(self, solid: "Solid", state: State) -> None:
        """Add a solid that moves with a vehicle's `state`; its axes are the body's."""
        self._pinger.add(solid, state)

    def sample(self, time_ns: int, state: State) -> SonarImageSample:
        """Return the measurement of `state`."""
        m = self._model
        picture = self._picture.make(self._intensities(time_ns, state).T)
        return SonarImageSample(
            time_ns, self._angles, self._bins.count, m.min_range, m.range_step, m.frequency, m.sound_speed,
            m.beam_width, m.beam_height, self._picture.encoding, picture,
        )  # fmt: skip

    def _intensities(self, time_ns: int, state: State) -> "Floats":
        """Return the mean intensities, echo / source (directions x bins)."""
        import numpy as np

        from sim.sensors.imaging.ping_motion import sonar_motion

        m = self._model
        groups = self._scale.measure(state, self._pinger.ping(time_ns, state))
        if not groups:
            return np.zeros((m.beams, self._bins.count), np.float32)
        echoes = self._pinger.distribute(groups[0], self._bins, self._stride).astype(np.float32)
        return sonar_motion(state, self._mounting, None).shift_beams(echoes, self._bins, m.sector / m.beams)


def _aperture(model: ForwardSonarModel, angles: "Floats", spacing: float) -> "Aperture":
    """Return one column of rays in the middle of each beam, over the height of the main lobe."""
    import numpy as np

    from sim.rays.splitting import Lattice
    from sim.sensors.imaging.echoes import Aperture, beam_pattern, first_null

    lobe = first_null(model.beam_height)
    edges = np.linspace(-lobe, lobe, model.rays + 1)
    downs = 0.5 * (edges[1:] + edges[:-1])

    lattice = Lattice(np.linspace(-0.5 * model.sector, 0.5 * model.sector, model.beams + 1), edges)

    def receiver_pattern(toward: "Floats") -> "Floats":
        return beam_pattern(np.arcsin(toward[:, 2].clip(-1.0, 1.0)), model.beam_height)

    solid_angles = spacing * (np.sin(edges[1:]) - np.sin(edges[:-1]))
    weights = solid_angles * beam_pattern(downs, model.beam_height) ** 2
    directions, edge_directions = (lattice.unit(*np.meshgrid(angles, down, indexing="ij")) for down in (downs, edges))
    weights = np.tile(weights, (model.beams, 1))
    return Aperture(directions, edge_directions, weights, lattice, model.beam_height, receiver_pattern=receiver_pattern)
