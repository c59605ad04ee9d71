"""A slave with imaging sensors: their process, its pictures, its restarts and its processor time."""

import io
import signal
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
from hil.recording.reader import read_messages
from hil.recording.tap import ONE_THREAD
from hil.ros.diagnostics import or_nan
from hil.scenario.config import load_scenario
from hil.slave.imaging.process import join
from sim.environment.world import load_world
from tests.support.clients.imaging_slave import (
    HEIGHT,
    PICTURES,
    SENSORS,
    WIDTH,
    has_all,
    kill_and_wait,
    start,
    wait_for,
    watched_slave,
)
from tests.support.processes import ROOT, Program, is_running, write_scenario

pytestmark = pytest.mark.timeout(280)


@pytest.fixture
def slave(tmp_path: Path) -> Iterator[tuple[Program, VehicleClient]]:
    with watched_slave(tmp_path) as watched:
        yield watched


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


def imaging_pid(client: VehicleClient) -> int:
    return wait_for(lambda: client.diagnostics().imaging_pid or 0) or 0


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


def test_a_killed_imaging_process_is_reported_and_restarted(slave: tuple[Program, VehicleClient]) -> None:
    program, client = slave
    assert wait_for(lambda: has_all(client)), client.received
    kill_and_wait(program, client, 1)
    assert "signal 9; started again in 0.5 s" in program.output


def test_the_single_link_of_the_imaging_process_is_not_cut(tmp_path: Path) -> None:
    """A master has two links with a slave, and a single one of a pair is cut. The imaging process has only one."""
    scenario = load_scenario(str(write_scenario(tmp_path)[0]))
    with listen(scenario.slave.listen), join(scenario) as session:
        assert wait_for(session.links)
        assert len(session.links()) == 1
        assert not session.has_pairs


IDLE = 0.03  # of a core, of a process that makes no pictures; those below take four times as much where it is calm


def test_pictures_are_rendered_only_for_subscribers(tmp_path: Path) -> None:
    """The processor time of the process shows whether pictures are rendered."""
    program, endpoint = start(tmp_path, "[sensors.camera]\nrate = 10\nwidth = 640\nheight = 480\n")
    with program, VehicleClient(endpoint, "uuv1") as client:
        program.expect("ready")
        assert wait_for(lambda: or_nan(client.diagnostics().imaging_cpu_s) > 0.0)
        assert wait_for(lambda: takes(client, 0.9) < IDLE), "nobody watches"
        with VehicleClient(endpoint, "uuv1", role="observer") as onlooker:
            onlooker.watch("camera/depth/image_raw")
            assert wait_for(lambda: onlooker.received["camera/depth/image_raw"] > 3)
            assert wait_for(lambda: takes(client, 0.9) > 2.0 * IDLE)
        assert wait_for(lambda: takes(client, 0.9) < IDLE), "the onlooker has gone"


def test_a_sonar_fan_and_a_scanning_sonar_are_sent_to_their_subscribers(tmp_path: Path) -> None:
    """A subscriber of the fan alone gets it; a scanning sonar with intensities sends ranges and echoes."""
    sensors = (
        "[sensors.forward_sonar]\nrate = 5\nbeams = 64\n"
        '[sensors.scanning_sonar]\ndevice = "ping360"\nbins = 200\nmax_range = 20.0\n'
    )
    program, endpoint = start(tmp_path, sensors)
    topics = "forward_sonar/fan/image_raw", "scanning_sonar", "scanning_sonar/image"
    with program:
        program.expect("ready")
        with VehicleClient(endpoint, "uuv1") as client:
            client.watch(*topics)
            assert wait_for(lambda: all(client.received[topic] > 3 for topic in topics))
            fan, scan, echoes = (client.latest[topic].value for topic in topics)
            assert fan.encoding == "mono8"
            assert max(fan.data) > 50
            assert len(scan.ranges) == 1
            assert (echoes.bins, len(echoes.beams)) == (200, 1)
            assert client.received["forward_sonar/image"] == 0


def test_a_lost_first_picture_does_not_end_the_pictures(tmp_path: Path) -> None:
    """The first picture only shows which topics exist."""
    program, endpoint = start(tmp_path, "[sensors.camera]\nrate = 20\nwidth = 40\nheight = 30\ndrop_out = 0.9\n")
    with program, VehicleClient(endpoint, "uuv1") as client:
        client.watch("camera/camera_info")
        assert wait_for(lambda: client.received["camera/camera_info"] > 3)


def takes(client: VehicleClient, seconds: float) -> float:
    """Return the processor's share that pictures take, for so long."""

    def spent() -> tuple[float, float]:
        stamped = client.latest["diagnostics"]
        return or_nan(stamped.value.imaging_cpu_s), stamped.sent_ns / 1e9

    before, began = spent()
    assert wait_for(lambda: spent()[1] > began + seconds)  # diagnostics come once a second
    after, ended = spent()
    return (after - before) / (ended - began)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_the_imaging_process_ends_with_the_slave(slave: tuple[Program, VehicleClient], number: int) -> None:
    program, client = slave
    pid = imaging_pid(client)
    assert is_running(pid)
    code = program.stop(number)
    assert code == (-9 if number == signal.SIGKILL else 0)
    assert wait_for(lambda: not is_running(pid))
    assert "Traceback" not in program.output
    assert "the imaging process ended" not in program.output


def start_with_pillow(folder: Path, text: str) -> Program:
    """Return a slave whose Pillow package consists of this text."""
    package = folder / "other" / "PIL"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text(text)
    return start(folder, environment={"PYTHONPATH": str(package.parent)})[0]


def test_a_missing_package_is_reported_once(tmp_path: Path) -> None:
    with start_with_pillow(tmp_path, "raise ImportError") as program:
        program.expect(r"no pictures: pictures as JPEG need Pillow: pip install 'uuv-hil\[imaging\]'")
        assert program.process.poll() is None
        assert "ended" not in program.output


def test_the_reason_of_its_end_is_reported_and_restarts_become_rarer(tmp_path: Path) -> None:
    with start_with_pillow(tmp_path, "raise RuntimeError('no lens')") as program:
        for pause in ("0.5", "1"):
            program.expect(
                rf"the imaging process ended, exit code 1: RuntimeError: no lens; started again in {pause} s"
            )
        assert program.process.poll() is None
        assert "Traceback" not in program.output


def test_pictures_are_in_recordings_of_clients_but_not_of_the_slave(tmp_path: Path) -> None:
    """The slave's own recording is still repeated bit for bit."""
    folder = tmp_path / "recording"
    program, endpoint = start(tmp_path, f'{SENSORS}\n[recording]\nslave = true\nfolder = "{folder}"\n')
    with program:
        program.expect("ready")
        with VehicleClient(endpoint, "uuv1", role="observer") as onlooker:
            onlooker.watch(*PICTURES)
            assert wait_for(lambda: has_all(onlooker)), "they take their time to begin"
        with Program(
            tmp_path, "recording", "make", "--connect", endpoint, "-o", tmp_path / "bag", "--seconds", "3"
        ) as recorder:
            assert recorder.wait() == 0, recorder.output
        assert program.stop(signal.SIGINT) == 0
    topics = {message.topic for message in read_messages(str(tmp_path / "bag"))}
    assert {f"/uuv1/{topic}" for topic in PICTURES} <= topics
    (recording,) = folder.iterdir()
    assert not any("camera" in message.topic for message in read_messages(str(recording)))
    with Program(tmp_path, "recording", "replay", recording, "--check") as check:
        assert check.wait() == 0, check.output
        assert "the same bit for bit" in check.output


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
