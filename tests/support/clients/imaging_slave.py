"""A slave with imaging sensors, and a client of it."""

import functools
import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

from hil.client.client import VehicleClient
from hil.ros.diagnostics import Diagnostics
from tests.support import processes
from tests.support.processes import Program, write_scenario

# The process has nice 10: where many others work, its turn comes late.
wait_for = functools.partial(processes.wait_for, seconds=200.0)
WIDTH, HEIGHT = 64, 48
SENSORS = f"""
[ros]
images = "both"
[sensors.camera]
rate = 10
width = {WIDTH}
height = {HEIGHT}
depth_noise = 0
points = true
[sensors.forward_sonar]
rate = 5
beams = 64
"""
PICTURES = (
    "camera/image_raw", "camera/image_raw/compressed", "camera/camera_info", "camera/depth/image_raw",
    "camera/depth/points", "forward_sonar/image",
)  # fmt: skip


def start(folder: Path, sensors: str = SENSORS, environment: dict[str, str] | None = None) -> tuple[Program, str]:
    """Start a slave with these sensors; return it and its endpoint."""
    scenario, port = write_scenario(folder, top=sensors)
    return Program(folder, "slave", scenario, environment=environment), f"tcp/127.0.0.1:{port}"


def start_with_pillow(folder: Path, text: str) -> Program:
    """Return a slave whose Pillow package consists of this text."""
    package = folder / "other" / "PIL"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text(text)
    return start(folder, environment={"PYTHONPATH": str(package.parent)})[0]


@contextmanager
def watched_slave(folder: Path) -> Iterator[tuple[Program, VehicleClient]]:
    """Provide a slave with these sensors that is ready, and a client that has subscribed to all its pictures."""
    program, endpoint = start(folder)
    with program:
        program.expect("ready")
        with VehicleClient(endpoint, "uuv1") as client:
            client.watch(*PICTURES)
            yield program, client


def has_all(client: VehicleClient) -> bool:
    """Return whether three of each kind of picture have arrived."""
    return all(client.received[topic] > 2 for topic in PICTURES)


def camera(client: VehicleClient, figure: Literal["requested", "dropped", "took_ms"]) -> float:
    """Return a figure of the camera's pictures, as last reported."""
    figures: dict[str, float] = client.diagnostics()[f"imaging_{figure}"]
    return figures["camera"]


def newest(client: VehicleClient) -> Diagnostics:
    """Return the present diagnostics, not those of up to a second ago: the second of the next two messages."""
    before = client.received["diagnostics"]
    assert wait_for(lambda: client.received["diagnostics"] > before + 1)
    return client.diagnostics()


def kill_and_wait(program: Program, client: VehicleClient, restarts: int) -> tuple[Diagnostics, Diagnostics]:
    """Kill the imaging process and wait for the next one's pictures; return the diagnostics before and after."""
    previous = newest(client)
    os.kill(previous.imaging_pid or 0, signal.SIGKILL)
    program.expect(rf"(?s)(WARNING: the imaging process ended, signal 9; started again in .*){{{restarts}}}")
    before = client.received["camera/image_raw"], client.received["imu"]
    assert wait_for(lambda: client.received["camera/image_raw"] > before[0] + 3)
    assert client.received["imu"] > before[1] + 50, "the loop goes on"
    now = newest(client)
    assert now.imaging_restarts == restarts
    assert now.imaging_pid != previous.imaging_pid
    return previous, now
