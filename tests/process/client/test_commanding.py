"""The right to command through the Python interface, and the stop of the vehicle when a program ends."""

import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

import hil
from hil.client.client import REFUSED_NS, VehicleClient
from hil.common.clock import NS_PER_S
from hil.common.errors import NetworkError
from hil.ros.commands import encode_thrusts
from tests.support.network.python_api import endpoint, fleet, own_slave, vehicle
from tests.support.processes import ROOT, Program, run_here, wait_for, write_scenario

__all__ = ["endpoint", "fleet", "own_slave", "vehicle"]  # the fixtures


def test_an_action_continues_after_the_slave_was_restarted(own_slave: tuple[Program, str], tmp_path: Path) -> None:
    program, endpoint = own_slave
    with hil.connect(endpoint, wait=60.0) as fleet:
        vehicle = fleet["uuv1"]
        reported = vehicle.go_to(4.4, 4.2, 2.0)
        stream = vehicle.samples("imu")
        program.process.kill()
        with pytest.raises(NetworkError, match=r"has not answered .*fleet\.wait_for"):
            for _ in stream:
                pass
        for ask in (lambda: vehicle.imu, vehicle.stop):
            with pytest.raises(NetworkError, match="has not answered "):
                ask()
        assert not vehicle.present
        assert fleet.names == []
        program.wait()
        with Program(tmp_path, "slave", tmp_path / "short.toml") as second_slave:
            assert fleet.wait_for("uuv1", seconds=60) == [vehicle]
            assert wait_for(lambda: vehicle.imu.age < 0.5)
            assert reported.wait(60).done, "the action is still to be done"
            assert second_slave.process.poll() is None


def test_reading_continues_after_a_short_silence_of_the_slave(own_slave: tuple[Program, str]) -> None:
    program, endpoint = own_slave
    with hil.connect(endpoint, wait=60.0) as fleet:
        vehicle = fleet["uuv1"]
        stream = vehicle.samples("imu")
        program.process.send_signal(signal.SIGSTOP)
        assert wait_for(lambda: not vehicle.present)
        threading.Timer(0.1, program.process.send_signal, (signal.SIGCONT,)).start()
        assert next(stream)
        assert vehicle.imu
        assert vehicle.present, "both waited until it was back"


def test_a_second_master_is_refused_unless_it_takes_over(own_slave: tuple[Program, str]) -> None:
    program, endpoint = own_slave
    with hil.connect(endpoint, wait=60.0) as first:
        first["uuv1"].drive(surge=0.1)
        program.expect("commands arrive")
        with hil.connect(endpoint, wait=60.0) as second:
            for _ in range(2):
                with pytest.raises(NetworkError, match=r"is commanded by another master.*take_over=True"):
                    second["uuv1"].drive(surge=-0.3)
            assert not second["uuv1"].client.has_commanded
        with hil.connect(endpoint, take_over=True, wait=60.0) as third:
            reported = first["uuv1"].go_to(6.0, 6.0, 2.0)
            third["uuv1"].drive(surge=0.1)
            with pytest.raises(NetworkError, match="another master"):
                reported.wait(60)
        with hil.connect(endpoint, observe=True, wait=60.0) as watching, pytest.raises(NetworkError, match="observed"):
            watching["uuv1"].stop()


def test_a_master_is_informed_when_another_takes_over(own_slave: tuple[Program, str]) -> None:
    """A completed action reports it too, because its goal is no longer held."""
    program, endpoint = own_slave
    with hil.connect(endpoint, wait=60.0) as first, hil.connect(endpoint, take_over=True, wait=60.0) as second_client:
        reported = first["uuv1"].drive(surge=0.1).wait(60)
        program.expect("commands arrive")
        second_client["uuv1"].drive(surge=-0.1)
        assert wait_for(lambda: bool(reported.error))
        with pytest.raises(NetworkError, match="another master"):
            reported.wait()


def test_the_first_command_is_sent_at_once(endpoint: str) -> None:
    """The command is not delayed by the previous master, which the last diagnostics may still name."""
    for _ in range(2):
        with hil.connect(endpoint, wait=60.0) as fleet:
            vehicle = fleet["uuv1"]
            began = time.monotonic()
            vehicle.stop()
            assert time.monotonic() - began < REFUSED_NS / NS_PER_S, "the time for which a refusal is waited for"
            time.sleep(0.3)  # the vehicle tells who commands


def test_commands_to_a_disarmed_vehicle_are_refused(own_slave: tuple[Program, str]) -> None:
    _, endpoint = own_slave
    code, output = run_here("topic", "call", "/uuv1/arm", "{data: false}", "--connect", endpoint)
    assert code == 0, output
    with hil.connect(endpoint, wait=60.0) as fleet:
        assert wait_for(lambda: fleet["uuv1"].diagnostics.armed is False)
        with pytest.raises(NetworkError, match=r"disarmed.*/uuv1/arm"):
            fleet["uuv1"].stop()


def test_commands_to_a_vehicle_with_an_external_controller_are_refused(tmp_path: Path) -> None:
    scenario, port = write_scenario(tmp_path, top='controller = "external"')
    with Program(tmp_path, "slave", scenario) as slave:
        slave.expect("ready")
        with hil.connect(f"tcp/127.0.0.1:{port}", wait=60.0) as fleet:
            assert wait_for(lambda: fleet["uuv1"].imu.age < 0.2)
            with pytest.raises(NetworkError, match="external"):
                fleet["uuv1"].stop()


def test_the_slave_reports_why_it_refused_a_command(own_slave: tuple[Program, str]) -> None:
    _, endpoint = own_slave
    with VehicleClient(endpoint, "uuv1") as client:
        assert client.wait_for_vehicle(60)
        sent_count = 0

        def is_reported() -> bool:
            nonlocal sent_count  # again: what finds others waiting to be sent is dropped
            sent_count = client.send("cmd_thrusters", encode_thrusts((1.0,) * 5))
            return bool(client.diagnostics().commands_fault)

        assert wait_for(is_reported)
        assert client.diagnostics().commands_fault == "cmd_thrusters: 5 thrusts for 6 thrusters"
        assert 1 <= (client.diagnostics().commands_malformed or 0) <= sent_count


PROGRAM_THAT_ENDS = """
import sys, time
import hil
fleet = hil.connect("{endpoint}", wait=60.0)
fleet["uuv1"].push(x=20.0)
print("pushing", flush=True)
sys.stdin.readline()
{ending}
"""


@pytest.mark.parametrize(
    ("ending", "code"),
    [("", 0), ("raise ValueError('x')", 1), ("sys.exit(7)", 7), ("while True: time.sleep(0.05)", -signal.SIGINT)],
)
def test_the_vehicle_stops_however_the_program_ends(endpoint: str, ending: str, code: int) -> None:
    with hil.connect(endpoint, observe=True, wait=60.0) as watching:
        vehicle = watching["uuv1"]
        text = PROGRAM_THAT_ENDS.format(endpoint=endpoint, ending=ending)
        with subprocess.Popen(
            [sys.executable, "-c", text],
            cwd=ROOT,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        ) as program:
            assert program.stdout is not None
            assert program.stdout.readline() == "pushing\n"
            assert wait_for(lambda: vehicle.diagnostics.commanded_by != "")
            if code < 0:
                program.send_signal(signal.SIGINT)
            _, output = program.communicate("\n", timeout=60)
        assert program.returncode == code, output
        assert wait_for(lambda: vehicle.diagnostics.commanded_by == "")
        assert wait_for(lambda: set(vehicle.diagnostics.pwm_us or ()) == {1500})


def test_closing_ends_the_threads_and_the_iterations(endpoint: str) -> None:
    before = set(threading.enumerate())
    fleet = hil.connect(endpoint, wait=60.0)
    vehicle = fleet["uuv1"]
    stream = vehicle.samples("imu")
    vehicle.stop()
    next(stream)
    fleet.close()
    fleet.close()
    assert len(list(stream)) < 256
    assert wait_for(lambda: set(threading.enumerate()) == before)
    with pytest.raises(NetworkError, match="connect again"):
        _ = vehicle.imu
    with pytest.raises(NetworkError, match="connect again"):
        fleet["uuv1"]
