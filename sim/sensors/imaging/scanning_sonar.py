"""A mechanically scanned sonar: one beam that a motor turns by a step after each ping."""

from math import pi
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from hil.common.schema import Range
from sim.dynamics import State
from sim.rotations import from_euler, to_euler
from sim.sensors.error import ErrorModel, sensor_random
from sim.sensors.extra_samples import LaserSample
from sim.sensors.imaging.samples import EchoSample, SonarImageSample, require_numpy
from sim.sensors.mounting import Mounting
from sim.sensors.ranging.beams import Beams, RangeErrors, apply_limits, cone
from sim.sensors.samples import Scene

if TYPE_CHECKING:
    from sim.rays.solids import Solid
    from sim.sensors.imaging.echoes import Aperture, Floats

Angle = Annotated[float, Range(-2.0 * pi, 2.0 * pi, "rad")]
_DEGREE = pi / 180.0
_SIDE_LOBES = 8  # number of side lobes on each side, each one slice of rays
# dB re the source: level of the transducer's ringing directly after the pulse. In a log of a Ping360 set to 2 m the
# picture is white up to 5 cm, half as bright at 12 cm, and noise from 0.6 m on
# (github.com/noahaosman/Ping360_Log_Reader, test_ping_log).
_RINGING_LEVEL = -26.0
_SAMPLES = 16  # of the pattern within a slice, for its mean


class ScanningSonarModel(NamedTuple):
    """Pings in Hz (0: none), the sector and the step (rad), the beam's width and height (rad), reach, error.

    `rings` of rays represent the beam for the distance. With `bins` above 0 a ping also has this number of intensities,
    from `min_range` to `max_range`; then the sensor needs numpy and runs in the process of the cameras and sonars.
    `slices` x `rays` represent the beam for the intensities; the other keys are those of
    sim.sensors.imaging.forward_sonar.ForwardSonarModel. The transducer sends and receives with the same pattern, so
    side lobes apply to both ways; by default the first of them is that of an unshaded element. `ringing` also hides the
    first echo. Echoes are as long as a pulse of `pulse_length` s, by default that of a Ping360 for this reach (see
    sim.sensors.imaging.pulse); speckle is correlated within a pulse and between pings that overlap. With `ground_truth`
    the distances are the true ones, and the intensities are the mean ones of a pulse as short as a bin.

    The defaults are those of a Blue Robotics Ping360. From its data sheet: a beam of 2 x 25 deg, steps of 0.9 deg (1
    grad), 0.75 to 50 m with 1200 samples per ping, 35 s for a turn at full range. From the Ping protocol (device_data):
    750 kHz, 8 bits. A pulse of one element is one look. The error of the scale is that of an error of 7 m/s in the
    speed of sound. Levels and the picture are our choice.
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
    temperature: Annotated[float, Range(-2.0, 40.0, "°C")] = 10.0
    salinity: Annotated[float, Range(0.0, 45.0)] = 35.0
    sound_speed: Annotated[float, Range(1300.0, 1800.0, "m/s")] = 1500.0
    source_level: Annotated[float, Range(100.0, 250.0, "dB")] = 200.0
    noise_level: Annotated[float, Range(0.0, 200.0, "dB")] = 70.0
    seabed_strength: Annotated[float, Range(-80.0, 10.0, "dB")] = -27.0
    object_strength: Annotated[float, Range(-80.0, 10.0, "dB")] = -20.0
    surface_strength: Annotated[float, Range(-200.0, 10.0, "dB")] = -30.0
    glint: Annotated[float, Range(0.0, 60.0, "dB")] = 0.0
    volume_strength: Annotated[float, Range(-200.0, 0.0, "dB")] = -200.0
    pulse_length: Annotated[float, Range(0.0, 0.1, "s")] | None = None
    looks: Annotated[float, Range(0.0, 1000.0)] = 1.0
    side_lobes: Annotated[float, Range(0.0, 100.0, "dB")] = 13.3
    ringing: Annotated[float, Range(0.0, 10.0, "m")] = 0.0
    tvg: Annotated[float, Range(0.0, 1.0)] = 1.0
    gain: Annotated[float, Range(-100.0, 100.0, "dB")] = 12.0
    contrast: Annotated[float, Range(0.1, 3.0)] = 0.7
    noise_grey: Annotated[float, Range(0.01, 1.0)] = 0.15
    ground_truth: bool = False

    @property
    def offloaded(self) -> bool:
        """True if it measures intensities, which takes too long for the loop of a slave."""
        return self.bins > 0

    def validate(self) -> str | None:
        """Return what is wrong with the combination of the keys, or None."""
        if max(self.min_range, self.ringing) >= self.max_range:
            return "min_range or ringing is not below max_range"
        if self.bins and not (self.beam_width and self.beam_height):
            return "bins needs a beam_width and a beam_height above 0"
        if not self.step <= self.angle_max - self.angle_min <= 2.0 * pi:
            return "angle_max must be above angle_min by a step or more, and by a turn at most"
        return None


class ScanningSonar:
    """A beam in the sensor's x-y plane, at an angle from x (ahead) towards y (starboard). A sample is one range.

    With a sector of 360 deg the head turns continuously, with a smaller one it turns forth and back. Each ping is
    measured at the vehicle's position at that time, so the scan of a moving vehicle is skewed like a real one. The
    distance is that of the first echo, the shortest along any of the rays. Not modelled: side lobes above and below the
    beam, echoes of earlier pings.
    """

    Model = ScanningSonarModel
    topic = "scanning_sonar"

    def __init__(self, model: ScanningSonarModel, mounting: Mounting, seed: int, scene: Scene) -> None:
        self._first, self._step = model.angle_min, model.step
        sector = model.angle_max - model.angle_min
        self._steps = int(sector / model.step + 1e-9)  # from one end to the other
        self._whole_turn = sector > 2.0 * pi - 1e-9
        self._ping = 0
        self._limits = max(model.min_range, model.ringing), model.max_range
        self._beams = Beams(scene, mounting, cone(model.beam_width, model.beam_height, model.rings), model.max_range)
        random = sensor_random(seed, self.topic)
        self._echo_recorder = EchoRecorder(model, mounting, seed, scene, self.topic) if model.bins else None
        self._errors = None if model.ground_truth else RangeErrors(model.error, 1.0 / model.rate, random, self._limits)

    def add(self, solid: "Solid", state: State) -> None:
        """Add a solid that moves with a vehicle's `state`, in body axes. It affects only the intensities."""
        if self._echo_recorder:
            self._echo_recorder.add(solid, state)

    def aim(self, angle: float) -> None:
        """Turn the head, so that the next ping is at `angle` (rad) and those after it go on from there."""
        self._first, self._ping = angle, 0

    def sample(self, time_ns: int, state: State) -> Any:
        """Return the measurement of `state`, a LaserSample, or an EchoSample with `bins`; turn the head by one step."""
        angle = self._first + self._step_number() * self._step
        self._ping += 1
        true = (min(self._beams.ranges(time_ns, state, from_euler(0.0, 0.0, angle))),)
        measured = self._errors.measure(true) if self._errors else apply_limits(true, true, self._limits)
        scan = LaserSample(time_ns, angle, self._step, measured, self._limits)
        return (
            EchoSample(time_ns, scan, self._echo_recorder.measure(time_ns, state, angle))
            if self._echo_recorder
            else scan
        )

    def _step_number(self) -> int:
        """Return the head's present number of steps from the first angle."""
        if self._whole_turn:
            return self._ping % self._steps
        step = self._ping % (2 * self._steps)
        return min(step, 2 * self._steps - step)


class EchoRecorder:
    """Measures the echoes of one beam by range, with one pattern for sending and receiving; `sonar` is its topic."""

    def __init__(self, model: ScanningSonarModel, mounting: Mounting, seed: int, scene: Scene, sonar: str) -> None:
        require_numpy(sonar)
        from sim.sensors.imaging.echoes import Bins
        from sim.sensors.imaging.pinger import Pinger
        from sim.sensors.imaging.pulse import PulseReceiver, aperture_length, ping360_pulse
        from sim.sensors.imaging.sonar_picture import Picture, RangeScale

        topic = f"{sonar}/echoes"
        self._model, self._step = model, (model.max_range - model.min_range) / model.bins
        aperture = _aperture(model)
        self._pingers = [Pinger(scene, mounting, aperture, model)]
        if model.side_lobes:
            self._pingers.append(Pinger(scene, mounting, _side_lobe_aperture(model), model))
        self._bins = Bins(model.min_range, self._step, model.bins, self._pingers[0].absorption)
        seconds = model.pulse_length
        if seconds is None:
            seconds = ping360_pulse(model.max_range, self._step, model.sound_speed)
        pulse = max(0.5 * seconds * model.sound_speed / self._step, 1.0)
        solid_angle = float(aperture.weights.sum())
        self._picture = Picture(model, self._bins, solid_angle, seed, topic, pulse=pulse, ringing_level=_RINGING_LEVEL)
        across = aperture_length(model.beam_width, model.sound_speed / model.frequency)
        self._mounting = mounting
        self._receiver = PulseReceiver(model.bins, pulse, model.beam_width, across, model.looks, self._picture.random)
        # The same random numbers as for the distances: the same device has the same error of its clock.
        self._scale = RangeScale(model, mounting, seed, topic, scene, sonar)

    def add(self, solid: "Solid", state: State) -> None:
        """Add a solid that moves with a vehicle's `state`."""
        for pinger in self._pingers:
            pinger.add(solid, state)

    def measure(self, time_ns: int, state: State, angle: float) -> SonarImageSample:
        """Return the echoes of a ping of `state` with the head at `angle` (rad)."""
        import numpy as np

        m = self._model
        head = from_euler(0.0, 0.0, angle)
        groups = self._scale.measure(state, *[pinger.ping(time_ns, state, head) for pinger in self._pingers])
        mean = np.zeros(m.bins)
        if groups:
            mean = self._pingers[0].distribute(groups[0], self._bins).sum(axis=0)
        for echoes in groups[1:]:
            mean += self._bins.distribute(echoes, 2 * _SIDE_LOBES).sum(axis=0)
        return SonarImageSample(
            time_ns, (angle,), m.bins, m.min_range, self._step, m.frequency, m.sound_speed, m.beam_width,
            m.beam_height, self._picture.encoding, self._make_picture(mean, state, angle),
        )  # fmt: skip

    def _make_picture(self, mean: "Floats", state: State, angle: float) -> bytes:
        """Return the picture of a ping, from its `mean` intensities (bins), with the head at `angle` (rad)."""
        import numpy as np

        picture = self._picture
        if self._model.ground_truth:
            return picture.make(mean[:, None])
        heading = to_euler(self._mounting.attitude(state))[2]
        position = np.array(self._mounting.world_position(state))
        received = self._receiver.receive(mean, float(picture.noise), picture.ringing, heading + angle, position)
        return picture.encode(received[:, None])


def _aperture(model: ScanningSonarModel) -> "Aperture":
    """Return slices of the main lobe side by side, each with rays from its upper to its lower end."""
    import numpy as np

    from sim.sensors.imaging.echoes import beam_pattern, first_null

    lobe = first_null(model.beam_width)
    edges = np.linspace(-lobe, lobe, model.slices + 1)

    def receiver_pattern(toward: "Floats") -> "Floats":
        across, down = np.arctan2(toward[:, 1], toward[:, 0]), np.arcsin(toward[:, 2].clip(-1.0, 1.0))
        return beam_pattern(across, model.beam_width) * beam_pattern(down, model.beam_height)

    column_weights = beam_pattern(0.5 * (edges[1:] + edges[:-1]), model.beam_width) ** 2
    return _make_slices(model, edges, model.rays, column_weights)._replace(receiver_pattern=receiver_pattern)


def _side_lobe_aperture(model: ScanningSonarModel) -> "Aperture":
    """Return one slice for each side lobe, on both sides of the main lobe, with its mean strength."""
    import numpy as np

    from sim.sensors.imaging.echoes import array_pattern, beam_pattern, first_null

    span = min(_SIDE_LOBES * first_null(model.beam_width), 0.5 * pi)
    edges = np.linspace(-span, span, 2 * _SIDE_LOBES + 1)
    fractions = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
    angles = edges[:-1, None] + np.diff(edges)[:, None] * fractions
    lobes = array_pattern(angles, model.beam_width, model.side_lobes) - beam_pattern(angles, model.beam_width)
    return _make_slices(model, edges, max(model.rays // 2, 1), (lobes**2).mean(axis=1))


def _make_slices(model: ScanningSonarModel, edges: "Floats", rays: int, column_weights: "Floats") -> "Aperture":
    """Return slices side by side between `edges` (rad), weighted with `column_weights` and the pattern over height."""
    import numpy as np

    from sim.rays.splitting import Lattice
    from sim.sensors.imaging.echoes import Aperture, beam_pattern, first_null

    lobe = first_null(model.beam_height)
    lattice = Lattice(edges, np.linspace(-lobe, lobe, rays + 1))
    across = 0.5 * (edges[1:] + edges[:-1])
    downs = 0.5 * (lattice.down[1:] + lattice.down[:-1])
    row_weights = np.diff(np.sin(lattice.down)) * beam_pattern(downs, model.beam_height) ** 2
    weights = np.outer(column_weights * np.diff(edges), row_weights)
    directions, edge_directions = (
        lattice.unit(*np.meshgrid(across, down, indexing="ij")) for down in (downs, lattice.down)
    )
    left, right = (lattice.unit(*np.meshgrid(side, downs, indexing="ij")) for side in (edges[:-1], edges[1:]))
    return Aperture(directions, edge_directions, weights, lattice, model.beam_height, column_weights, (left, right))
