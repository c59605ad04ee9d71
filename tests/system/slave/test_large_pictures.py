"""Processor time of a camera of 640 x 480 beside sonars, and of the imaging process.

All limits are relative to processor time measured at the same time, as rates depend on the machine and its load.
"""

import time
from collections.abc import Callable
from pathlib import Path
from statistics import median

import numpy as np
import pytest

from hil.client.client import VehicleClient
from hil.ros.diagnostics import Diagnostics
from hil.scenario.config import load_scenario
from hil.slave.imaging.process import Studio
from tests.support.clients.imaging_slave import newest, wait_for
from tests.support.processes import Program, write_scenario

pytestmark = pytest.mark.timeout(280)
SENSORS = """
[sensors.camera]
rate = 15
width = 640
height = 480
orientation = ["0 deg", "-30 deg", "0 deg"]
[sensors.forward_sonar]
orientation = ["0 deg", "-15 deg", "0 deg"]
[sensors.side_scan]
"""
TOPICS = ("camera/image_raw/compressed", "forward_sonar/image", "side_scan/image")  # by the number of the sensor
MOVING = [0.0, 0.0, 5.0, 1.0, *[0.0] * 15]
PIXELS = 640 * 480
WORLD = "ridge"


def thread_s(work: Callable[[], object]) -> float:
    """Return the processor time that this thread takes for it."""
    began = time.thread_time()
    work()
    return time.thread_time() - began


def make(studio: Studio, number: int) -> None:
    """Make a sample and its messages, as the imaging process does."""
    list(studio.encode(studio.take_sample(number, 0, MOVING), 0, lambda _: False))


@pytest.fixture
def scenario(tmp_path: Path) -> tuple[Path, int]:
    return write_scenario(tmp_path, top=SENSORS)


@pytest.fixture
def studio(scenario: tuple[Path, int]) -> Studio:
    whole = load_scenario(str(scenario[0]), {"world": WORLD})
    offloaded = {name: fitted for name, fitted in whole.sensors.items() if fitted.offloaded}
    return Studio(whole._replace(sensors=offloaded))


def test_a_picture_takes_at_most_four_times_its_noise_in_numpy(studio: Studio) -> None:
    """A picture has rays, light, noise and JPEG; numpy's noise is the reference for the speed of the processor."""
    random = np.random.default_rng(1)
    pictures, noises = [], []
    for _ in range(15):  # in turn, so that both have the same neighbours
        pictures.append(thread_s(lambda: make(studio, 0)))
        noises.append(thread_s(lambda: random.standard_normal((PIXELS, 3))))
    assert min(pictures) < 4.0 * min(noises)


def test_the_imaging_process_spends_its_time_on_pictures(
    tmp_path: Path, scenario: tuple[Path, int], studio: Studio
) -> None:
    """The process takes little more than its pictures and pings take here at the same time."""
    path, port = scenario
    with Program(tmp_path, "slave", path, "--set", f"world={WORLD}") as program:
        program.expect("ready")
        with VehicleClient(f"tcp/127.0.0.1:{port}", "uuv1") as client:
            client.watch(*TOPICS)
            assert wait_for(lambda: all(client.received[topic] > 2 for topic in TOPICS)), program.output
            took: list[list[float]] = [[], [], []]
            first, then = newest(client), taken(client)
            for _ in range(40):
                for number, each in enumerate(took):
                    each.append(thread_s(lambda number=number: make(studio, number)))  # type: ignore[misc]
                time.sleep(0.1)
            last, now = newest(client), taken(client)
        made = [after - before for before, after in zip(then, now, strict=True)]
        known_s = sum(count * median(each) for count, each in zip(made, took, strict=True))
        used_s = cpu_s(last) - cpu_s(first)
        assert min(made) > 3
        assert used_s < 1.6 * known_s


def taken(client: VehicleClient) -> list[int]:
    """Return how many messages of each have come."""
    return [client.received[topic] for topic in TOPICS]


def cpu_s(figures: Diagnostics) -> float:
    """Return the processor time of the imaging process so far."""
    return figures.imaging_cpu_s or 0.0
