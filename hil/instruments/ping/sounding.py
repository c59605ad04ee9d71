"""What the echo sounders of the ping protocol share: one beam down, its echoes by range, the bottom among them."""

from abc import abstractmethod
from math import isfinite, isnan, pi
from typing import Any, NamedTuple

from hil.instruments.ping.protocol import PingDevice
from sim.rotations import from_euler, multiply, to_euler
from sim.sensors.imaging.samples import EchoSample
from sim.sensors.imaging.scanning_sonar import ScanningSonar, ScanningSonarModel

_PROCESSING_NS = 5_000_000  # after the last echo; our choice
_NEAR = 3  # points on each side of the bottom among which its strongest echo is
MODEL_DB = 12.0  # gain with which the echoes are those of the simulated sensor's defaults


class Window(NamedTuple):
    """What a ping covers: its begin and length (m, by the device's speed of sound, m/s), points, and gain (dB)."""

    start: float
    length: float
    speed: float
    points: int
    gain: float


class Sounding(NamedTuple):
    """A ping: distance (m), nan without an echo; confidence (%); strength of the echoes by range, a byte each."""

    distance: float
    confidence: int
    profile: bytes


class EchoSounder(PingDevice):
    """A device that pings again and again and reports each ping when its last echo has come.

    `covered` are its fields of begin and length (mm) and speed of sound (mm/s), `gain` that of the number of its gain,
    one of `gains` (dB), `number_of_points` that of a ping's results. It reaches `reach` m. Its beam is about the z
    axis of its sensor.
    """

    sensors = ("echosounder",)
    frequency = reach = 0.0  # Hz, m
    covered: tuple[str, str, str]
    gain = ""
    gains: list[float]

    def prepare(self) -> None:
        """Set its state at power on."""
        super().prepare()
        # The beam of a scanning sonar is about x. Its bearing around z does not matter: the beam is round.
        turned = multiply(self.facts.mounting.quaternion, from_euler(0.0, -0.5 * pi, 0.0))
        self._mounting = self.facts.mounting._replace(orientation=to_euler(turned))
        self._sounding: tuple[float, Sounding]

    @abstractmethod
    def interval_ns(self) -> int:
        """Return the least time between two pings."""

    @abstractmethod
    def is_on(self) -> bool:
        """Return whether it pings."""

    @abstractmethod
    def report(self, end: float, distance: float, sounding: Sounding, at_ns: int) -> None:
        """Take a ping to the range `end` (m) that is complete at `at_ns`; `distance` is that end without an echo."""

    def start(self, now_ns: int) -> None:
        """Begin to ping."""
        self.timers[self.ping] = now_ns

    def adapt(self, end: float, sounding: Sounding, the_range: bool, the_gain: bool) -> None:
        """Choose the next range, with the bottom at two thirds, and gain: the strongest echo high, within the limit."""
        values, (start, length, _), distance = self.values, self.covered, sounding.distance
        if the_range:
            is_fitting = 0.4 * end < distance < 0.85 * end
            best = end if is_fitting else min(max(1.5 * distance, 1.0), self.reach)
            best = min(2.0 * end, self.reach) if isnan(distance) else best
            values |= {start: 0, length: round(1000.0 * best)}
        if the_gain:
            peak = max(sounding.profile)
            values[self.gain] = min(max(values[self.gain] + (peak < 100) - (peak >= 255), 0), len(self.gains) - 1)

    def ping(self, due_ns: int, now_ns: int) -> None:
        """Ping, and say when it does next and reports."""
        values, listening_ns, measured = self.values, _PROCESSING_NS, None
        if self.is_on():
            start, length, speed = [values[name] / 1000.0 for name in self.covered]
            window = Window(start, length, speed, values["number_of_points"], MODEL_DB + self.gains[values[self.gain]])
            listening_ns += round(2e9 * (start + length) / speed)
            measured = self._measure(window, now_ns)
            if measured:
                self._sounding, self.timers[self._arrive] = (start + length, measured), now_ns + listening_ns
        self.timers[self.ping] = max(due_ns + max(self.interval_ns(), listening_ns), now_ns)

    def _arrive(self, due_ns: int, _: int) -> None:
        end, sounding = self._sounding
        self.report(end, end if isnan(sounding.distance) else sounding.distance, sounding, due_ns)

    def _measure(self, window: Window, now_ns: int) -> Sounding | None:
        """Return a ping; None while the vehicle's state is not known."""
        state, sonar = self.scene.state(now_ns), self._sonar(window)
        sonar.aim(0.0)
        sample = self.scene.measure(sonar, now_ns) if state else None
        if state is None or not isinstance(sample, EchoSample):
            return None
        true, profile = sample.scan.ranges[0], sample.echoes.intensities
        distance = true * window.speed / self.facts.sound_speed(self._mounting.depth(state))
        if not (isfinite(true) and window.start <= distance < window.start + window.length):
            return Sounding(float("nan"), 0, profile)
        at = int((distance - window.start) / window.length * window.points)
        peak = max(profile[max(at - _NEAR, 0) : at + _NEAR + 1])
        noise = sorted(profile)[window.points // 2]
        return Sounding(distance, min(100, round(200.0 * max(peak - noise, 0) / 255.0)), profile)

    def _sonar(self, window: Window) -> Any:
        given = self.facts.model
        # The error of the scale stands for that of the speed of sound, which the device is told here.
        model = ScanningSonarModel(
            rate=4.0, beam_width=given.beam_width, beam_height=given.beam_width, rings=given.rings,
            min_range=window.start, max_range=window.start + window.length, error=given.error._replace(scale=0.0),
            bins=window.points, frequency=self.frequency, sound_speed=window.speed, gain=window.gain, side_lobes=0.0,
            ground_truth=False, slices=3, rays=32,
        )  # fmt: skip
        return self.tuned(model, self._mounting, ScanningSonar)
