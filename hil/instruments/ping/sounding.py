"""What the echo sounders of the ping protocol share: one beam down, its echoes by range, the bottom among them."""

from math import isfinite, pi
from typing import Any, NamedTuple

from hil.instruments.contract import Facts, Scene
from sim.rotations import from_euler, multiply, to_euler
from sim.sensors.error import ErrorModel
from sim.sensors.imaging.samples import EchoSample
from sim.sensors.imaging.scanning_sonar import ScanningSonar, ScanningSonarModel

_NEAR = 3  # points on each side of the bottom among which its strongest echo is


class Window(NamedTuple):
    """What a ping covers: its begin and length (m, by the device's speed of sound, m/s), points, and gain (dB)."""

    start: float
    length: float
    points: int
    gain: float
    speed: float


class Sounding(NamedTuple):
    """A ping: distance (m), nan without an echo; confidence (%); strength of the echoes by range, a byte each."""

    distance: float
    confidence: int
    profile: bytes


class Sounder:
    """The beam of an echo sounder, about the z axis of its sensor. `frequency` in Hz, `interval` between pings in s."""

    def __init__(self, facts: Facts, scene: Scene, frequency: float, interval: float) -> None:
        self._facts, self._scene, self._frequency, self._interval = facts, scene, frequency, interval
        # The beam of a scanning sonar is about x. Its bearing around z does not matter: the beam is round.
        turned = multiply(facts.mounting.quaternion, from_euler(0.0, -0.5 * pi, 0.0))
        self._mounting = facts.mounting._replace(orientation=to_euler(turned))
        self._window: Window | None = None
        self._sensor: Any = None

    def measure(self, window: Window, now_ns: int) -> Sounding | None:
        """Return a ping; None while the vehicle's state is not known."""
        if window != self._window:
            self._sensor, self._window = self._build(window), window
        state = self._scene.state(now_ns)
        self._sensor.aim(0.0)
        sample = self._scene.measure(self._sensor, now_ns) if state else None
        if state is None or not isinstance(sample, EchoSample):
            return None
        true = sample.scan.ranges[0]
        profile = sample.echoes.intensities
        distance = true * window.speed / self._facts.sound_speed(self._mounting.depth(state))
        if not (isfinite(true) and window.start <= distance < window.start + window.length):
            return Sounding(float("nan"), 0, profile)
        at = int((distance - window.start) / window.length * window.points)
        peak = max(profile[max(at - _NEAR, 0) : at + _NEAR + 1])
        noise = sorted(profile)[window.points // 2]
        return Sounding(distance, min(100, round(200.0 * max(peak - noise, 0) / 255.0)), profile)

    def _build(self, window: Window) -> Any:
        given = self._facts.model
        # The error of the scale stands for that of the speed of sound, which the device is told here.
        error: ErrorModel = given.error._replace(scale=0.0)
        model = ScanningSonarModel(
            rate=1.0 / self._interval, beam_width=given.beam_width, beam_height=given.beam_width, rings=given.rings,
            min_range=window.start, max_range=window.start + window.length, error=error, bins=window.points,
            frequency=self._frequency, sound_speed=window.speed, gain=window.gain, side_lobes=0.0,
            ground_truth=False, slices=3, rays=32,
        )  # fmt: skip
        return self._scene.build(model, self._mounting, ScanningSonar)
