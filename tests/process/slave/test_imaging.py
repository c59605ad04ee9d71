"""A slave with imaging sensors: their process, its pictures, its restarts and its processor time."""

import io
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from hil.client.client import VehicleClient
from hil.network.opening import listen
from hil.recording.tap import ONE_THREAD
from hil.scenario.config import load_scenario
from hil.slave.imaging.process import join
from sim.environment.world import load_world
from tests.support.clients.imaging_slave import (
    HEIGHT,
    PICTURES,
    SENSORS,
    WIDTH,
    has_all,
    start,
    start_with_pillow,
    wait_for,
)
from tests.support.processes import ROOT, write_scenario

pytestmark = pytest.mark.timeout(280)


@pytest.fixture(scope="module")
def watched(tmp_path_factory: pytest.TempPathFactory) -> Iterator[VehicleClient]:
    """Provide a master that receives every picture of a slave, shared by tests that do not disturb it.

    The environment sets the single library thread of a recorder, with which a slave used to pass on no sonar image.
    """
    program, endpoint = start(tmp_path_factory.mktemp("watched"), environment={"ZENOH_RUNTIME": ONE_THREAD})
    with program, VehicleClient(endpoint, "uuv1") as client:
        client.watch(*PICTURES)
        assert wait_for(lambda: has_all(client)), program.output
        yield client


def test_pictures_arrive_unchanged(watched: VehicleClient) -> None:
    latest: dict[str, Any] = {topic: watched.latest[topic].value for topic in PICTURES}
    raw, packed = latest["camera/image_raw"], latest["camera/image_raw/compressed"]
    assert (raw.width, raw.height, raw.encoding) == (WIDTH, HEIGHT, "rgb8")
    assert Image.open(io.BytesIO(packed.data)).size == (WIDTH, HEIGHT)
    assert len(set(raw.data)) > 10, "something is on it"
    sonar = latest["forward_sonar/image"]
    assert len(sonar.beams) == 64
    assert sonar.beams[0] < 0 < sonar.beams[-1]
    assert len(sonar.intensities) == 64 * sonar.bins


def test_the_depth_image_shows_the_floor_below(watched: VehicleClient) -> None:
    """The depth along the optical axis is the pool floor's, from the middle column at the lower edge."""
    picture, info = (watched.latest[f"camera/{name}"].value for name in ("depth/image_raw", "camera_info"))
    depth = np.frombuffer(picture.data, "<f4").reshape(HEIGHT, WIDTH)
    water = load_world("pool").depth - watched.latest["ground_truth"].value.position[2]
    expected = water * info.intrinsics.fy / (HEIGHT - 1 - info.intrinsics.cy)
    assert depth[-1, WIDTH // 2] == pytest.approx(expected, rel=0.1)
    assert depth[-1, WIDTH // 2] < depth[HEIGHT // 2, WIDTH // 2]


def test_the_point_cloud_matches_the_depth_image(watched: VehicleClient) -> None:
    """A cloud and a depth image of one instant agree through the camera's pinhole, in its frame: z ahead, y down."""

    def both_pictures() -> tuple[Any, Any] | None:
        cloud, picture = (watched.latest[f"camera/depth/{name}"].value for name in ("points", "image_raw"))
        return (cloud, picture) if cloud.time_ns == picture.time_ns else None

    found = wait_for(both_pictures)
    assert found
    cloud, picture = found
    assert (cloud.width, cloud.height) == (WIDTH, HEIGHT)
    x, y, z, _ = np.frombuffer(cloud.data, "<f4").reshape(HEIGHT, WIDTH, 4).transpose(2, 0, 1)
    depth = np.frombuffer(picture.data, "<f4").reshape(HEIGHT, WIDTH)
    fx, fy, cx, cy = watched.latest["camera/camera_info"].value.intrinsics
    columns, rows = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    has_depth = np.isfinite(depth)
    assert has_depth.sum() > 1000
    assert (np.isnan(z) == ~has_depth).all()
    for axis, expected in ((x, (columns - cx) / fx * depth), (y, (rows - cy) / fy * depth), (z, depth)):
        assert axis[has_depth] == pytest.approx(expected[has_depth], abs=1e-4)


def test_picture_stamps_are_those_of_the_simulation(watched: VehicleClient) -> None:

    def agree() -> bool:
        """Return whether both have the same instants, 20 a second, as long as no step was skipped in between."""
        truth = watched.latest["ground_truth"].value.time_ns
        stamps = [watched.latest[topic].value.time_ns for topic in PICTURES]
        assert all(abs(stamp - time.time_ns()) < 60_000_000_000 for stamp in stamps), "of the same clock"
        return all((stamp - truth) % 50_000_000 == 0 for stamp in stamps)

    assert wait_for(agree)
    figures = watched.diagnostics()
    assert (figures.imaging_requested or {})["camera"] > 0
    assert figures.imaging_restarts == 0


def test_the_single_link_of_the_imaging_process_is_not_cut(tmp_path: Path) -> None:
    """A master has two links with a slave, and a single one of a pair is cut. The imaging process has only one."""
    scenario = load_scenario(str(write_scenario(tmp_path)[0]))
    with listen(scenario.slave.listen), join(scenario) as session:
        assert wait_for(session.links)
        assert len(session.links()) == 1
        assert not session.has_pairs


def test_a_missing_package_is_reported_once(tmp_path: Path) -> None:
    with start_with_pillow(tmp_path, "raise ImportError") as program:
        program.expect(r"no pictures: pictures as JPEG need Pillow: pip install 'uuv-hil\[imaging\]'")
        assert program.process.poll() is None
        assert "ended" not in program.output


LEAN = """
import sys
from hil.scenario.config import load_scenario
from hil.slave.imaging.sensors import Imaging
import hil.slave.daemon
imaging = Imaging(load_scenario(sys.argv[1]), print)
assert set(imaging.dropped) == {0}
print(*sorted({"numpy", "PIL", "subprocess", "socket", "ctypes", "hil.ros.images"} & set(sys.modules)))
"""


def test_the_slave_process_imports_no_imaging_modules(tmp_path: Path) -> None:
    scenario, _ = write_scenario(tmp_path, top=SENSORS)
    done = subprocess.run([sys.executable, "-c", LEAN, scenario], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == []
