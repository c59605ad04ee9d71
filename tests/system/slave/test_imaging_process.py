"""The imaging process of a slave: who gets pictures, its restarts and its end."""

import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from hil.client.client import VehicleClient
from hil.recording.reader import read_messages
from hil.ros.diagnostics import or_nan
from tests.support.clients.imaging_slave import (
    PICTURES,
    SENSORS,
    has_all,
    kill_and_wait,
    start,
    start_with_pillow,
    wait_for,
    watched_slave,
)
from tests.support.processes import Program, is_running

pytestmark = pytest.mark.timeout(280)


@pytest.fixture
def slave(tmp_path: Path) -> Iterator[tuple[Program, VehicleClient]]:
    with watched_slave(tmp_path) as watched:
        yield watched


def imaging_pid(client: VehicleClient) -> int:
    return wait_for(lambda: client.diagnostics().imaging_pid or 0) or 0


def test_a_killed_imaging_process_is_reported_and_restarted(slave: tuple[Program, VehicleClient]) -> None:
    program, client = slave
    assert wait_for(lambda: has_all(client)), client.received
    kill_and_wait(program, client, 1)
    assert "signal 9; started again in 0.5 s" in program.output


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
