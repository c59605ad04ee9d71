"""A mechanically scanned sonar: one beam that a motor turns by a step after each ping."""

from math import pi
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from hil.common.schema import Range
from sim.dynamics import State
from sim.rotations import from_euler
from sim.sensors.error import ErrorModel, sensor_random
from sim.sensors.extra_samples import LaserSample
from sim.sensors.imaging.samples import EchoSample, SonarImageSample, need_numpy
from sim.sensors.mounting import Mounting
from sim.sensors.ranging.beams import Beams, RangeErrors, cone, within
from sim.sensors.samples import Scene

if TYPE_CHECKING:
    from sim.rays.solids import Solid
    from sim.sensors.imaging.echoes import Aperture

Angle = Annotated[float, Range(-2.0 * pi, 2.0 * pi, "rad")]
_DEGREE = pi / 180.0


class ScanningSonarModel(NamedTuple):
    """Pings in Hz (0: none), the sector and the step (rad), the beam's width and height (rad), reach, error.

    `rings` of rays stand for the beam. With `bins` a ping also gives so many intensities, from `min_range` to
    `max_range`; then the sensor needs numpy and runs beside cameras and sonars. `slices` x `rays` stand for the beam in
    these; the other keys are those of sim.sensors.imaging.forward_sonar.ForwardSonarModel. With `ground_truth` the
    distances are the true ones, and intensities the mean ones.

    Blue Robotics Ping360 (data sheet): 2 x 25 deg, steps of 0.9 deg (1 grad), 0.75 to 50 m with 1200 samples a ping,
    35 s a turn at full reach; 750 kHz, 8 bits (Ping protocol, device_data). Scale: a speed of sound that is 7 m/s off;
    levels and the picture are our choice.
    """

    rate: Annotated[float, Range(0.0, 1000.0, "Hz")] = 11.0
    angle_min: Angle = -pi
    angle_max: Angle = pi
    step: Annotated[float, Range(1e-4, pi, "rad")] = 0.9 * _DEGREE
    beam_width: Annotated[float, Range(0.0, pi, "rad")] = 2.0 * _DEGREE
    beam_height: Annotated[float, Range(0.0, pi, "rad")] = 25.0 * _DEGREE
    rings: Annotated[int, Range(0, 20)] = 2
    min_range: Annotated[float, Range(0.0, 10.0, "m")] = 0.75
    max_range: Annotated[float, Range(0.1, 1000.0, "m")] = 50.0
    error: ErrorModel = ErrorModel(scale=0.005, resolution=50.0 / 1200.0)
    bins: Annotated[int, Range(0, 20_000)] = 0
    slices: Annotated[int, Range(1, 64)] = 7
    rays: Annotated[int, Range(1, 4096)] = 96
    frequency: Annotated[float, Range(1e4, 5e6, "Hz")] = 750e3
    temperature: Annotated[float, Range(-2.0, 40.0)] = 10.0
    salinity: Annotated[float, Range(0.0, 45.0)] = 35.0
    sound_speed: Annotated[float, Range(1300.0, 1800.0, "m/s")] = 1500.0
    source_level: Annotated[float, Range(100.0, 250.0)] = 200.0
    noise_level: Annotated[float, Range(0.0, 200.0)] = 70.0
    seabed_strength: Annotated[float, Range(-80.0, 10.0)] = -27.0
    object_strength: Annotated[float, Range(-80.0, 10.0)] = -20.0
    surface_strength: Annotated[float, Range(-200.0, 10.0)] = -30.0
    volume_strength: Annotated[float, Range(-200.0, 0.0)] = -200.0
    looks: Annotated[float, Range(0.0, 1000.0)] = 2.0
    tvg: Annotated[float, Range(0.0, 1.0)] = 1.0
    gain: Annotated[float, Range(-100.0, 100.0)] = 12.0
    contrast: Annotated[float, Range(0.1, 3.0)] = 0.7
    noise_grey: Annotated[float, Range(0.01, 1.0)] = 0.15
    ground_truth: bool = False

    @property
    def offloaded(self) -> bool:
        """True if it makes pictures."""
        return self.bins > 0

    def validate(self) -> str | None:
        """Return what is wrong between the keys, or None."""
        if self.min_range >= self.max_range:
            return "min_range is not below max_range"
        if not self.step <= self.angle_max - self.angle_min <= 2.0 * pi:
            return "angle_max must be above angle_min by a step or more, and by a turn at most"
        return None


class ScanningSonar:
    """A beam in the sensor's x-y plane, at an angle from x (ahead) towards y (starboard). A sample is one range.

    Over a whole turn the head goes round. Over a sector it goes there and back. Each ping is measured from where the
    vehicle is then, so a scan of a moving vehicle is skewed as a real one is. The distance is that of the first echo,
    the least along any of the rays. Not modelled: side lobes, echoes of earlier pings, the turn of the head during a
    ping.
    """

    Model = ScanningSonarModel
    topic = "scanning_sonar"

    def __init__(self, model: ScanningSonarModel, mounting: Mounting, seed: int, scene: Scene) -> None:
        self._first, self._step = model.angle_min, model.step
        sector = model.angle_max - model.angle_min
        self._steps = int(sector / model.step + 1e-9)  # from one end to the other
        self._whole_turn = sector > 2.0 * pi - 1e-9
        self._ping = 0
        self._limits = model.min_range, model.max_range
        self._beams = Beams(scene, mounting, cone(model.beam_width, model.beam_height, model.rings), model.max_range)
        random = sensor_random(seed, self.topic)
        self._echoes = Intensities(model, mounting, seed, scene, self.topic) if model.bins else None
        self._errors = None if model.ground_truth else RangeErrors(model.error, 1.0 / model.rate, random, self._limits)

    def add(self, solid: "Solid", state: State) -> None:
        """Add to its intensities a solid that goes with a vehicle's `state`, its own axes the body's."""
        if self._echoes:
            self._echoes.pinger.add(solid, state)

    def sample(self, time_ns: int, state: State) -> Any:
        """Return the measurement of `state`, a LaserSample, with `bins` an EchoSample; the head turns on."""
        angle = self._first + self._place() * self._step
        self._ping += 1
        true = (min(self._beams.ranges(time_ns, state, from_euler(0.0, 0.0, angle))),)
        measured = self._errors.measure(true) if self._errors else within(true, true, self._limits)
        scan = LaserSample(time_ns, angle, self._step, measured, self._limits)
        return EchoSample(time_ns, scan, self._echoes.measure(time_ns, state, angle)) if self._echoes else scan

    def _place(self) -> int:
        """Return how many steps from the first angle the head stands."""
        if self._whole_turn:
            return self._ping % self._steps
        there = self._ping % (2 * self._steps)
        return min(there, 2 * self._steps - there)


class Intensities:
    """The echoes of a ping by range, of one beam that sends and receives; `sonar` is the topic of its sonar."""

    def __init__(self, model: ScanningSonarModel, mounting: Mounting, seed: int, scene: Scene, sonar: str) -> None:
        need_numpy(sonar)
        import numpy as np

        from sim.environment.seawater.absorption import francois_garrison
        from sim.sensors.imaging.bottom_echo import make_texture
        from sim.sensors.imaging.echoes import Bins
        from sim.sensors.imaging.pinger import Pinger
        from sim.sensors.imaging.sonar_picture import Picture, RangeScale

        topic = f"{sonar}/echoes"
        self._model, self._step = model, (model.max_range - model.min_range) / model.bins
        absorption = francois_garrison(model.frequency, model.temperature, model.salinity)
        aperture = _aperture(model)
        self.pinger = Pinger(scene, mounting, aperture, model.max_range, absorption, model)
        self._bins = Bins(model.min_range, self._step, model.bins, absorption)
        ranges = model.min_range + (np.arange(model.bins) + 0.5) * self._step
        self._picture = Picture(model, ranges, absorption, float(aperture.weights.sum()), seed, topic)
        # The same device: its clock is as wrong as that of its distances.
        self._scale = RangeScale(model, mounting, seed, topic, scene, sonar)
        self._texture = make_texture(scene.world)

    def measure(self, time_ns: int, state: State, angle: float) -> SonarImageSample:
        """Return the echoes with the head at an angle (rad)."""
        import numpy as np

        from sim.sensors.imaging.bottom_echo import shares_of
        from sim.sensors.imaging.sonar_picture import encoding

        m = self._model
        echoes = self._scale.measure(self.pinger.ping(time_ns, state, from_euler(0.0, 0.0, angle)), state)
        mean = np.zeros(m.bins)
        if echoes is not None:
            shares = shares_of(echoes, self._bins, m.slices, self._texture)
            mean = self.pinger.with_water(shares, echoes, self._bins, m.volume_strength).sum(axis=0)
        return SonarImageSample(
            time_ns, (angle,), m.bins, m.min_range, self._step, m.frequency, m.sound_speed, m.beam_width,
            m.beam_height, encoding(m), self._picture.make(mean[:, None]),
        )  # fmt: skip


def _aperture(model: ScanningSonarModel) -> "Aperture":
    """Return slices of the main lobe beside each other, each from its upper to its lower end."""
    import numpy as np

    from sim.rays.splitting import Lattice
    from sim.sensors.imaging.echoes import Aperture, main_lobe, pattern

    wide, high = main_lobe(model.beam_width), main_lobe(model.beam_height)
    lattice = Lattice(np.linspace(-wide, wide, model.slices + 1), np.linspace(-high, high, model.rays + 1))
    edges = lattice.across
    across = 0.5 * (edges[1:] + edges[:-1])
    downs = 0.5 * (lattice.down[1:] + lattice.down[:-1])
    columns = pattern(across, model.beam_width) ** 2
    rows = np.diff(np.sin(lattice.down)) * pattern(downs, model.beam_height) ** 2
    weights = np.outer(columns * np.diff(edges), rows)
    middles, parted = (lattice.unit(*np.meshgrid(across, down, indexing="ij")) for down in (downs, lattice.down))
    left, right = (lattice.unit(*np.meshgrid(side, downs, indexing="ij")) for side in (edges[:-1], edges[1:]))
    return Aperture(middles, parted, weights, lattice, model.beam_height, columns, (left, right))
