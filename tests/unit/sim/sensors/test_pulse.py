"""A scanning sonar's pulse: how long it is, and the speckle that neighbouring bins and pings have in common."""

from math import pi, radians, sin
from typing import Any

import numpy as np
import pytest

from sim.dynamics import State
from sim.environment.obstacles import Box
from sim.sensors.imaging.pulse import PulseReceiver, aperture_length, ping360_pulse
from sim.sensors.imaging.scanning_sonar import ScanningSonar
from sim.sensors.mounting import Mounting
from sim.sensors.sensor_set import read_sensors
from tests.support.fitted import DEEP, scene

BINS = 20_000
WIDTH = radians(2.0)
POSITION = np.ones(3)
SILENT = np.zeros(BINS, np.float32)


def receiver(length: float, looks: float = 1.0) -> PulseReceiver:
    return PulseReceiver(BINS, length, WIDTH, aperture_length(WIDTH, 0.002), looks, np.random.default_rng(3))


def correlation(one: Any, other: Any) -> float:
    return float(np.corrcoef(one, other)[0, 1])


@pytest.mark.parametrize(
    ("reach", "microseconds", "samples"),
    [(2.0, 16e3 / 1.5e3, 1200), (50.0, 400e3 / 1.5e3, 1200), (0.5, 5.0, 1200), (100.0, 500.0, 1200),
     (20.0, 2.5 * 2.0 * 0.1e6 / 1500.0, 200)],
)  # fmt: skip
def test_a_pulse_grows_with_the_reach_as_the_maker_has_it(reach: float, microseconds: float, samples: int) -> None:
    """It is as long as two and a half samples at least."""
    assert ping360_pulse(reach, reach / samples, 1500.0) == pytest.approx(microseconds * 1e-6)


def test_intensities_are_those_of_all_that_the_pulse_covers_and_of_noise() -> None:
    mean = np.full(BINS, 2.0)
    received = receiver(4.5).receive(mean, 3.0, SILENT, 0.0, POSITION)
    assert received[10:].mean() == pytest.approx(4.5 * 2.0 + 3.0, rel=0.03)
    assert received[10:].std() == pytest.approx(received[10:].mean(), rel=0.06), "one look: exponential"
    exact = receiver(4.5, looks=0.0).receive(mean, 3.0, SILENT, 0.0, POSITION)
    assert exact[10:] == pytest.approx(12.0)


def test_a_point_echoes_from_its_range_on_as_long_as_the_pulse() -> None:
    point = np.zeros(BINS)
    point[100] = 1.0
    received = receiver(4.5, looks=0.0).receive(point, 0.0, SILENT, 0.0, POSITION)
    assert received[99:106] == pytest.approx([0.0, 1.0, 1.0, 1.0, 1.0, 0.5, 0.0])


def test_neighbouring_bins_are_alike_within_a_pulse() -> None:
    received = receiver(5.0).receive(np.ones(BINS), 0.0, SILENT, 0.0, POSITION)
    for lag in range(1, 8):
        expected = max(1.0 - lag / 5.0, 0.0) ** 2
        assert correlation(received[10:-lag], received[10 + lag :]) == pytest.approx(expected, abs=0.05)


@pytest.mark.parametrize("angle", [0.0, 0.45, 0.9, 1.3, 1.8, 3.6])
def test_pings_are_alike_as_far_as_their_beams_overlap(angle: float) -> None:
    sonar = receiver(1.0)
    first, second = (sonar.receive(np.ones(BINS), 0.0, SILENT, radians(a), POSITION) for a in (40.2, 40.2 + angle))
    x = 2.0 * pi * sin(radians(angle)) * 0.4429464 / sin(0.5 * WIDTH)
    amplitude = 6.0 * (1.0 - sin(x) / x) / x**2 if x else 1.0
    assert correlation(first, second) == pytest.approx(amplitude**2, abs=0.05)


def test_noise_differs_from_ping_to_ping_and_so_does_all_after_half_an_aperture() -> None:
    sonar = receiver(1.0)
    first, second = (sonar.receive(np.zeros(BINS), 1.0, SILENT, 0.0, POSITION) for _ in range(2))
    assert correlation(first, second) == pytest.approx(0.0, abs=0.03)
    for move, alike in ((0.014, 1.0), (0.016, 0.0)):  # half the aperture is 25.4 mm
        first, second = (sonar.receive(np.ones(BINS), 0.0, SILENT, 0.0, POSITION + x) for x in (0.0, move))
        assert correlation(first, second) == pytest.approx(alike, abs=0.03)


def scans(walls: tuple[Box, ...] = (), **keys: Any) -> Any:
    """Return 20 pings ahead of a Ping360 at rest, pings x bins."""
    model = read_sensors({"scanning_sonar": {"device": "ping360", **keys}}, "test")["scanning_sonar"].model
    model = model._replace(angle_min=0.0, angle_max=0.1)
    sonar = ScanningSonar(model, Mounting(), 1, scene(DEEP._replace(box=walls)))
    state = State((0.0, 0.0, 5.0), (1.0, 0.0, 0.0, 0.0), (0.0,) * 6)
    return np.array([np.frombuffer(sonar.sample(k, state).echoes.intensities, np.uint8) for k in range(20)])


def test_a_ping360_at_short_range_rings_as_a_real_one_does() -> None:
    rings = scans(max_range=2.0).mean(axis=0)
    at = [rings[round(metres / 2.0 * 1200)] for metres in (0.02, 0.12, 0.165, 0.33, 0.6)]
    # The means of a real one's log at those ranges: 245, 125, 84, 22, 6.
    assert at == pytest.approx([245.0, 125.0, 84.0, 22.0, 6.0], rel=0.2, abs=8.0)


def test_the_echo_of_a_wall_ends_later_by_the_length_of_the_pulse() -> None:
    wall = (Box(11.0, 0.0, 2.0, 20.0),)  # 10 m ahead
    middles = []
    for seconds in (40e-6, 400e-6):
        keys = {"max_range": 20.0, "pulse_length": seconds, "side_lobes": 0.0, "looks": 0.0, "gain": -20.0}
        bright = scans(wall, **keys)[3, 500:].astype(float) ** (2.0 / 0.7)
        bright[bright < 1e-2 * bright.max()] = 0.0
        middles.append(float((bright * np.arange(len(bright))).sum() / bright.sum()) * 20.0 / 1200)
    assert middles[1] - middles[0] == pytest.approx(0.5 * 0.5 * 360e-6 * 1500.0, rel=0.1)
