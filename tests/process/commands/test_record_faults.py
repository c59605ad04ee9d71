"""Recording under faults: a killed command, a full disk, no vehicle, wrong command lines."""

import resource
import signal
import time
from pathlib import Path

import pytest
from rosbags.highlevel import AnyReader

from hil.autonomy.control.controller import VelocityCommand
from hil.client.client import VehicleClient
from hil.common.clock import NS_PER_S
from hil.recording import tap
from hil.recording.reader import read_messages
from tests.support.network.recorded_dive import command_for, own_recording, recorded_slave
from tests.support.processes import Program, free_port, run_here, wait_for


def test_a_killed_recorder_leaves_a_readable_recording(tmp_path: Path) -> None:
    scenario, endpoint = recorded_slave(tmp_path)
    with Program(tmp_path, "recording", "make", "--scenario", scenario, "-o", tmp_path / "received") as record:
        record.expect("recording")
        with Program(tmp_path, "slave", scenario) as slave:
            command_for(endpoint, 1.8)
            for program in (record, slave):
                program.process.kill()
                program.wait()
    for path in (tmp_path / "received", own_recording(tmp_path / "recordings")):
        numbers = [message.sequence for message in read_messages(str(path)) if message.topic == "/uuv1/imu"]
        assert numbers == list(range(numbers[0], numbers[-1] + 1))
        assert len(numbers) > 70
        with AnyReader([path]) as reader:
            assert sum(connection.topic == "/uuv1/imu" for connection, _, _ in reader.messages()) == len(numbers)
    code, output = run_here("recording", "replay", str(own_recording(tmp_path / "recordings")), "--check")
    assert code == 0, output


def test_a_vehicle_continues_when_its_disk_is_full(tmp_path: Path) -> None:
    scenario, endpoint = recorded_slave(tmp_path)
    with Program(tmp_path, "slave", scenario) as slave:
        slave.expect("ready")
        limit = 40_000
        resource.prlimit(slave.process.pid, resource.RLIMIT_FSIZE, (limit, limit))
        with VehicleClient(endpoint, "uuv1") as client:
            assert client.wait_for_vehicle(60)

            def command() -> bool:
                client.command(VelocityCommand(surge=0.5, yaw_rate=0.2))
                time.sleep(0.05)
                return "recording into" in slave.output and "ended: File too large" in slave.output

            assert wait_for(command), slave.output
            steps = client.received["imu"]
            assert wait_for(lambda: command() and client.received["imu"] > steps + 50)
            assert wait_for(lambda: command() and abs(client.get("ground_truth").nu[0] - 0.5) < 0.15)
        assert slave.stop(signal.SIGTERM) == 0
    assert "thrusters neutral" in slave.output
    assert "Traceback" not in slave.output
    code, output = run_here("recording", "replay", str(own_recording(tmp_path / "recordings")), "--check")
    assert code == 0, output


def test_ctrl_c_ends_the_gateway_while_no_vehicle_is_connected(tmp_path: Path) -> None:
    endpoint, port = f"tcp/127.0.0.1:{free_port()}", free_port()
    for _ in range(3):
        with Program(tmp_path, "gateway", "foxglove", "--connect", endpoint, "--listen", port) as live:
            live.expect("ws://")
            assert live.stop(signal.SIGINT) == 0, live.output
        assert len(live.output.strip().splitlines()) == 2, "where it is, and for whom it waits"


def test_a_recording_without_a_slave_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tap, "PATIENCE_NS", NS_PER_S // 10)
    monkeypatch.setattr(tap, "save_resources", lambda: None)  # what this process starts later would inherit it
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    code, output = run_here(
        "recording", "make", "--connect", endpoint, "-o", str(tmp_path / "received"), "--seconds", "1"
    )
    assert code == 4, output
    assert f"still no answer from {endpoint}; waiting" in output
    assert f"nothing was recorded: no answer from {endpoint}" in output
    assert "none lost" not in output
