"""Slave and master as processes: missions, commands, faults, and how each process ends."""

import itertools
import json
import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import serial

from hil.client.client import VehicleClient
from hil.common.schema import find_preset
from hil.links.contract import ThrusterCommand, ThrusterTelemetry
from hil.links.frame.protocol import FrameProtocol
from tests.support.processes import Program, command_until, run_here, running_slave, surge_of, wait_for, write_scenario


def protocol() -> FrameProtocol:
    return FrameProtocol(find_preset("firmware_stub/frames", "uuv_hil"))


@pytest.fixture
def slave(tmp_path: Path) -> Iterator[tuple[Program, str]]:
    with running_slave(tmp_path) as started:
        yield started


def pulses(client: VehicleClient) -> list[int]:
    return list(client.diagnostics().pwm_us or ())


def test_a_mission_reaches_its_goal_and_writes_its_results(tmp_path: Path) -> None:
    scenario, _ = write_scenario(tmp_path)
    folder = tmp_path / "run"
    with Program(tmp_path, "demo", scenario, "--output", folder) as demo:
        assert demo.wait() == 0, demo.output
    assert "goal reached" in demo.output
    assert {"table.json", "track.csv", "trajectory.png", "master.log", "slave.log"} <= set(os.listdir(folder))
    record = json.loads((folder / "table.json").read_text())
    table, outcome = record["table"], record["outcome"]
    assert outcome["reached"]
    assert outcome["goal_error"] < 0.6
    assert 0 < table["startup_s"] < 60
    assert 0 < table["slave_ready_s"] <= table["startup_s"]
    assert 0 < table["slave_pss_mib"] < table["slave_rss_mib"] < 40
    assert table["commands"] > 50
    delay, hops = table["delay"], table["hops"].values()
    assert 0 < delay["p50_ms"] < 1000
    # Each delay is the sum of its hops, none of which is negative.
    assert max(hop["p50_ms"] for hop in hops) <= delay["p50_ms"]
    assert sum(hop["max_ms"] for hop in hops) >= delay["max_ms"] - 1e-9
    assert table["slave"]["link_checksum_errors"] == "0"
    assert int(table["slave"]["processes"]) == 1
    assert "thrusters neutral" in (folder / "slave.log").read_text()
    assert (folder / "trajectory.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_the_slave_with_neutral_thrusters(slave: tuple[Program, str], number: int) -> None:
    program, endpoint = slave
    with VehicleClient(endpoint, "uuv1") as client:
        assert command_until(lambda: any(pulse != 1500 for pulse in pulses(client)), client, surge=1.0)
        assert program.stop(number) == 0
    assert "thrusters neutral" in program.output.splitlines()[-1]
    assert "Traceback" not in program.output


def test_a_second_slave_on_the_same_device_reports_it(tmp_path: Path) -> None:
    device = tmp_path / "stm32"
    first, _ = write_scenario(tmp_path, link=f'port = "pty:{device}"')
    with Program(tmp_path, "slave", first) as slave:
        slave.expect("ready")
        second, _ = write_scenario(tmp_path, link=f'port = "pty:{device}"')
        with Program(tmp_path, "slave", second) as other:
            assert other.wait() == 3
            assert str(device) in other.output
            assert "Traceback" not in other.output


def test_external_vehicle_software_commands_the_thrusters(tmp_path: Path) -> None:
    """Any program that opens the port is the vehicle's computer with controller = "external"."""
    device = tmp_path / "stm32"
    scenario, port = write_scenario(tmp_path, top='controller = "external"', link=f'port = "pty:{device}"')
    with Program(tmp_path, "slave", scenario) as slave:
        slave.expect("waiting for your software")
        own = protocol()
        client = VehicleClient(f"tcp/127.0.0.1:{port}", "uuv1")
        with client, serial.Serial(str(device), 115_200, timeout=0.1, exclusive=True) as wire:
            assert client.wait_for_vehicle(60)
            received: list[ThrusterTelemetry] = []
            sequences = itertools.count(1)

            def moves_forward() -> bool:
                command = ThrusterCommand(next(sequences), True, (1600, 1600, 1600, 1600, 1500, 1500))
                wire.write(own.encode(command))
                time.sleep(0.03)
                received.extend(m for m in own.feed(wire.read(wire.in_waiting)) if isinstance(m, ThrusterTelemetry))
                return surge_of(client) > 0.3 and received[-1].sequence >= 58 and received[-1].armed

            assert wait_for(moves_forward)
        assert received[-1].pwm_us[:4] == (1600,) * 4


def test_a_slave_reconnects_to_a_device_on_a_serial_port(tmp_path: Path) -> None:
    """The slave opens stm32 = "device" by pyserial; its other end is the firmware's twin, then nothing."""
    device = tmp_path / "ttyUSB0"
    top, link = 'stm32 = "device"', f'port = "{device}"'
    scenario, port = write_scenario(tmp_path, top=top, link=link)
    with Program(tmp_path, "slave", scenario) as slave:
        assert slave.wait() == 3
        assert str(device) in slave.output
    with Program(tmp_path, "stm32", "--port", f"pty:{device}") as stm32:
        stm32.expect("Ctrl-C")
        with Program(tmp_path, "slave", scenario) as slave:
            slave.expect("ready")
            with VehicleClient(f"tcp/127.0.0.1:{port}", "uuv1") as client:
                assert client.wait_for_vehicle(60)
                assert command_until(
                    lambda: abs(surge_of(client) - 0.5) < 0.15 and len(client.delays) > 30, client, surge=0.5
                )
                stm32.stop(signal.SIGTERM)
                slave.expect("thruster link lost, the STM32's watchdog stops the thrusters")
                assert f"{device}: went away" in slave.output
                assert wait_for(lambda: client.diagnostics().pwm_us == (1500,) * 6)
                with Program(tmp_path, "stm32", "--port", f"pty:{device}") as again:
                    again.expect("Ctrl-C")
                    slave.expect("thruster link back")
                    delays = len(client.delays)
                    assert command_until(lambda: len(client.delays) > delays + 10, client, surge=0.5)
                    slave.stop(signal.SIGTERM)
            assert slave.output.count("thruster link lost") == slave.output.count("thruster link back") == 1
            assert "Traceback" not in slave.output


def test_ctrl_c_ends_the_demo(tmp_path: Path) -> None:
    scenario, _ = write_scenario(tmp_path)
    folder = tmp_path / "run"
    with Program(tmp_path, "demo", scenario, "--output", folder) as demo:
        demo.expect("flying")
        assert demo.stop(signal.SIGINT) == 130
        assert "Traceback" not in demo.output
    assert "thrusters neutral" in (folder / "slave.log").read_text().splitlines()[-1]


@pytest.mark.parametrize(
    ("text", "messages"),
    [
        ('vehicle = "paper_six"\nworld = "pool"\n[master]\ngoal = [1, 1]\n[start]\ndepth = 90\n', ["seabed"]),
        (
            'vehicle = "paper_six"\nworld = "pool"\n[sensors]\nimu = { rate = 0 }\n[master]\ngoal = [1, 1]\n',
            ["imu", "controller"],
        ),
        (
            'vehicle = "paper_six"\nworld = "pool"\nstm32 = "device"\n[start]\ndepth = 2\n[master]\ngoal = [1, 1]\n',
            ["--board"],
        ),
    ],
)
def test_a_wrong_scenario_is_one_clear_line(tmp_path: Path, text: str, messages: list[str]) -> None:
    path = tmp_path / "wrong.toml"
    path.write_text(text)
    code, output = run_here("slave", str(path))
    assert code == 2, output
    (line,) = output.strip().splitlines()
    assert all(word in line for word in messages), line


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["slave", "nowhere.toml"], 2, "nowhere.toml: no such file"),
        (["slave", "nowhere"], 2, "paper_field"),
        (["slave", "paper_field", "--listen", "7447"], 2, "tcp/HOST:PORT"),
        (["slave", "paper_field", "--board", "pi"], 2, "raspberry_pi_4b"),
        (["fly"], 2, "slave"),
        ([], 0, "usage"),
        (["--version"], 0, "uuv-hil"),
    ],
)
def test_command_lines_give_their_exit_code_and_message(arguments: list[str], code: int, message: str) -> None:
    found, output = run_here(*arguments)
    assert found == code, output
    assert message in output
