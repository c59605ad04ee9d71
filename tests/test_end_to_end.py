"""Slave and master as processes: the way of a command, and every way it can end."""

import json
import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import serial

from hil.autonomy.control import VelocityCommand
from hil.links.contract import ThrusterCommand, ThrusterTelemetry
from hil.links.frame.protocol import FrameProtocol
from hil.master.client import VehicleClient
from hil.schema import find_preset
from sim.native import NativeDynamics, choose
from tests.processes import Program, wait_for, write_scenario


def protocol() -> FrameProtocol:
    return FrameProtocol(find_preset("firmware_stub/frames", "uuv_hil"))


@pytest.fixture
def slave(tmp_path: Path) -> Iterator[tuple[Program, str]]:
    scenario, port = write_scenario(tmp_path)
    with Program(tmp_path, "slave", scenario) as program:
        program.expect("ready")
        yield program, f"tcp/127.0.0.1:{port}"


def pulses(client: VehicleClient) -> list[int]:
    return [int(pulse) for pulse in client.diagnostics().get("pwm_us", "").split()]


@pytest.mark.parametrize("stm32", ["python", "process"])
def test_a_mission(tmp_path: Path, stm32: str) -> None:
    scenario, _ = write_scenario(tmp_path, top=f'stm32 = "{stm32}"')
    folder = tmp_path / "run"
    with Program(tmp_path, "demo", scenario, "--run-dir", folder) as demo:
        assert demo.wait(90) == 0, demo.output
    assert "goal reached" in demo.output
    assert {"table.json", "track.csv", "trajectory.png", "master.log", "slave.log"} <= set(os.listdir(folder))
    record = json.loads((folder / "table.json").read_text())
    table, outcome = record["table"], record["outcome"]
    assert outcome["reached"]
    assert outcome["goal_error"] < 0.6
    assert 0 < table["startup_s"] < 5
    assert 0 < table["slave_ready_s"] <= table["startup_s"]
    assert 0 < table["slave_pss_mib"] < table["slave_rss_mib"] < (40 if stm32 == "python" else 60)
    assert table["commands"] > 50
    assert 0 < table["delay"]["p50_ms"] < 50
    assert sum(hop["p50_ms"] for hop in table["hops"].values()) == pytest.approx(table["delay"]["p50_ms"], rel=0.5)
    assert table["slave"]["link_checksum_errors"] == "0"
    assert int(table["slave"]["processes"]) == (1 if stm32 == "python" else 2)
    assert "thrusters neutral" in (folder / "slave.log").read_text()
    assert (folder / "trajectory.png").read_bytes().startswith(b"\x89PNG")


def test_deadman(slave: tuple[Program, str]) -> None:
    program, endpoint = slave
    with VehicleClient(endpoint, "uuv1") as client:
        assert client.wait_for_vehicle(10)
        began = time.monotonic()
        while time.monotonic() - began < 2.5:
            client.command(VelocityCommand(surge=0.5))
            time.sleep(0.05)
        assert client.latest["ground_truth"].value.nu[0] == pytest.approx(0.5, abs=0.15)
        assert any(pulse != 1500 for pulse in pulses(client))
        program.expect("deadman: no command in time, thrusters neutral", 2)
        assert wait_for(lambda: set(pulses(client)) == {1500}, 3)
        assert client.diagnostics()["deadman_trips"] == "1"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_the_slave_with_neutral_thrusters(slave: tuple[Program, str], number: int) -> None:
    program, endpoint = slave
    with VehicleClient(endpoint, "uuv1") as client:
        assert client.wait_for_vehicle(10)
        for _ in range(20):
            client.command(VelocityCommand(surge=1.0))
            time.sleep(0.05)
        assert program.stop(number) == 0
    assert "thrusters neutral" in program.output.splitlines()[-1]
    assert "Traceback" not in program.output


def test_a_second_slave_on_the_same_port_says_so(slave: tuple[Program, str], tmp_path: Path) -> None:
    _, endpoint = slave
    other, _ = write_scenario(tmp_path)
    with Program(tmp_path, "slave", other, "--listen", endpoint) as second:
        assert second.wait() == 4
        assert "in use" in second.output
        assert endpoint in second.output
        assert "Traceback" not in second.output


def test_a_second_slave_on_the_same_device_says_so(tmp_path: Path) -> None:
    device = tmp_path / "stm32"
    first, _ = write_scenario(tmp_path, link=f'port = "pty:{device}"')
    with Program(tmp_path, "slave", first) as slave:
        slave.expect("ready")
        second, _ = write_scenario(tmp_path, link=f'port = "pty:{device}"')
        with Program(tmp_path, "slave", second) as other:
            assert other.wait() == 3
            assert str(device) in other.output
            assert "Traceback" not in other.output


def test_garbage_from_the_network_is_counted_and_harmless(slave: tuple[Program, str]) -> None:
    program, endpoint = slave
    with VehicleClient(endpoint, "uuv1") as client:
        assert client.wait_for_vehicle(10)
        client.command(VelocityCommand())
        for payload in (b"", b"\0\1\0\0", b"\xff" * 52, bytes(100_000)):
            client._commands.put(payload, 0)
        assert wait_for(lambda: client.diagnostics().get("commands_malformed") == "4", 5), client.diagnostics()
    assert program.process.poll() is None


def test_foreign_vehicle_software_drives_the_thrusters(tmp_path: Path) -> None:
    """With controller = "external" any program that opens the port is the vehicle's computer."""
    device = tmp_path / "stm32"
    scenario, port = write_scenario(tmp_path, top='controller = "external"', link=f'port = "pty:{device}"')
    with Program(tmp_path, "slave", scenario) as slave:
        slave.expect("waiting for your software")
        ours = protocol()
        client = VehicleClient(f"tcp/127.0.0.1:{port}", "uuv1")
        with client, serial.Serial(str(device), 115_200, timeout=0.1, exclusive=True) as wire:
            assert client.wait_for_vehicle(10)
            heard: list[ThrusterTelemetry] = []
            for sequence in range(1, 60):
                command = ThrusterCommand(sequence, True, (1600, 1600, 1600, 1600, 1500, 1500))
                wire.write(ours.encode(command))
                time.sleep(0.05)
                heard += [m for m in ours.feed(wire.read(wire.in_waiting)) if isinstance(m, ThrusterTelemetry)]
            assert client.get("ground_truth").nu[0] > 0.3, "the vehicle moves forward"
        assert heard[-1].armed
        assert heard[-1].sequence >= 58
        assert heard[-1].pwm_us[:4] == (1600,) * 4


def test_a_device_on_a_serial_port(tmp_path: Path) -> None:
    """stm32 = "device" with pyserial; at the other end of the line the firmware's twin, then nothing."""
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
                assert client.wait_for_vehicle(10)
                for _ in range(40):
                    client.command(VelocityCommand(surge=0.5))
                    time.sleep(0.05)
                assert client.get("ground_truth").nu[0] == pytest.approx(0.5, abs=0.15)
                assert len(client.delays) > 30
                stm32.stop(signal.SIGTERM)
                slave.expect("thruster link lost, thrusters neutral")
                assert f"{device}: went away" in slave.output
                assert wait_for(lambda: client.diagnostics()["pwm_us"] == " ".join(["1500"] * 6), 5)
                with Program(tmp_path, "stm32", "--port", f"pty:{device}") as again:
                    again.expect("Ctrl-C")
                    slave.expect("thruster link back")
                    delays = len(client.delays)
                    for _ in range(20):
                        client.command(VelocityCommand(surge=0.5))
                        time.sleep(0.05)
                    assert len(client.delays) > delays + 10
                    slave.stop(signal.SIGTERM)
            assert slave.output.count("thruster link lost") == slave.output.count("thruster link back") == 1
            assert "Traceback" not in slave.output


def test_the_master_says_when_nobody_answers(tmp_path: Path) -> None:
    scenario, port = write_scenario(tmp_path)
    endpoint = f"tcp/127.0.0.1:{port}"
    with Program(
        tmp_path, "master", scenario, "--connect", endpoint, "--wait", 0.5, "--run-dir", tmp_path / "r"
    ) as master:
        assert master.wait() == 4
    assert endpoint in master.output
    assert "uuv-hil slave" in master.output
    assert "Traceback" not in master.output


def test_the_master_survives_a_slave_that_comes_back(tmp_path: Path) -> None:
    scenario, port = write_scenario(tmp_path)
    folder = tmp_path / "run"
    arguments = ("master", scenario, "--connect", f"tcp/127.0.0.1:{port}", "--run-dir", folder)
    with Program(tmp_path, *arguments) as master:
        with Program(tmp_path, "slave", scenario) as slave:
            master.expect("flying")
            time.sleep(1)
            slave.process.kill()
            slave.wait()
        master.expect("no word from the vehicle", 5)
        with Program(tmp_path, "slave", scenario):
            assert master.wait(60) == 0, master.output


def test_a_thruster_that_fails(tmp_path: Path) -> None:
    scenario, _ = write_scenario(tmp_path)
    whole = scenario.read_text()
    scenario.write_text(whole + '\n[[failure]]\nthruster = "front_left"\nkind = "off"\ntime = 1\n')
    with Program(tmp_path, "sim", scenario, "--fast") as lame:
        lame.wait(60)
    scenario.write_text(whole)
    with Program(tmp_path, "sim", scenario, "--fast") as sound:
        assert sound.wait(60) == 0
    assert lame.output.splitlines()[-1] != sound.output.splitlines()[-1]
    scenario.write_text(whole + '\n[[failure]]\nthruster = "front_lft"\nkind = "off"\ntime = 1\n')
    with Program(tmp_path, "sim", scenario, "--fast") as wrong:
        assert wrong.wait() == 2
    assert "front_left" in wrong.output
    assert "Traceback" not in wrong.output


def test_a_goal_that_cannot_be_reached(tmp_path: Path) -> None:
    scenario, _ = write_scenario(tmp_path)
    scenario.write_text(scenario.read_text().replace("goal = [8, 7]", "goal = [80, 7]"))
    with Program(tmp_path, "demo", scenario, "--run-dir", tmp_path / "run") as demo:
        assert demo.wait() == 6, demo.output
    assert "80" in demo.output
    assert "Traceback" not in demo.output


def test_a_time_limit_that_is_too_short(tmp_path: Path) -> None:
    scenario, _ = write_scenario(tmp_path)
    scenario.write_text(scenario.read_text().replace("time_limit = 40", "time_limit = 2"))
    with Program(tmp_path, "demo", scenario, "--run-dir", tmp_path / "run") as demo:
        assert demo.wait(60) == 6, demo.output
    assert "time limit" in demo.output
    assert (tmp_path / "run" / "table.json").exists(), "what was measured is not lost"


def final_state(folder: Path, scenario: Path, seed: int, native: bool) -> str:
    environment = {"UUV_HIL_NATIVE": str(int(native))}
    with Program(folder, "sim", scenario, "--fast", "--seed", seed, environment=environment) as sim:
        assert sim.wait(60) == 0, sim.output
        assert "goal reached" in sim.output
        return sim.output.splitlines()[-1]


def test_simulated_time_repeats_to_the_bit(tmp_path: Path) -> None:
    scenario, _ = write_scenario(tmp_path)
    first = final_state(tmp_path, scenario, 5, native=False)
    assert first.startswith("final state 0x")
    assert first == final_state(tmp_path, scenario, 5, native=False)
    assert first != final_state(tmp_path, scenario, 6, native=False)


@pytest.mark.skipif(choose()[0] is not NativeDynamics, reason="no C step here: python -m sim.native.build")
def test_a_whole_mission_is_the_same_in_c_to_the_bit(tmp_path: Path) -> None:
    scenario, _ = write_scenario(tmp_path)
    assert final_state(tmp_path, scenario, 5, native=True) == final_state(tmp_path, scenario, 5, native=False)


def test_ctrl_c_ends_the_demo(tmp_path: Path) -> None:
    scenario, _ = write_scenario(tmp_path)
    folder = tmp_path / "run"
    with Program(tmp_path, "demo", scenario, "--run-dir", folder) as demo:
        demo.expect("flying")
        time.sleep(1)
        assert demo.stop(signal.SIGINT) == 130
        assert "Traceback" not in demo.output
    assert "thrusters neutral" in (folder / "slave.log").read_text().splitlines()[-1]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("vehicle = 3\n", ["vehicle", "text"]),
        ('vehicel = "paper_six"\n', ["vehicel", "vehicle"]),
        ('vehicle = "paper_sex"\nworld = "pool"\n[master]\ngoal = [1, 1]\n', ["paper_six"]),
        (
            'vehicle = "paper_six"\nworld = "pool"\n[master]\ngoal = [1, 1]\n[slave]\ndeadman = 500\n',
            ["deadman", "500 s"],
        ),
        (
            'vehicle = "paper_six"\nworld = "pool"\n[master]\ngoal = [1, 1]\n[slave]\ndeadman = "x"\n',
            ["deadman", "1 s"],
        ),
        ("vehicle = ", ["TOML"]),
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
def test_a_wrong_scenario_is_one_clear_line(tmp_path: Path, text: str, words: list[str]) -> None:
    path = tmp_path / "wrong.toml"
    path.write_text(text)
    with Program(tmp_path, "slave", path) as slave:
        assert slave.wait() == 2, slave.output
    (line,) = slave.output.strip().splitlines()
    assert all(word in line for word in words), line


@pytest.mark.parametrize(
    ("arguments", "code", "word"),
    [
        (["slave", "nowhere.toml"], 2, "nowhere.toml: no such file"),
        (["slave", "nowhere"], 2, "paper_field"),
        (["slave", "paper_field", "--listen", "7447"], 4, "tcp/HOST:PORT"),
        (["slave", "paper_field", "--board", "pi"], 2, "raspberry_pi_4b"),
        (["fly"], 2, "slave"),
        ([], 0, "usage"),
        (["--version"], 0, "uuv-hil"),
        (["slave", "--help"], 0, "examples"),
        (["master", "--help"], 0, "examples"),
        (["demo", "--help"], 0, "examples"),
        (["stm32", "--help"], 0, "examples"),
        (["sim", "--help"], 0, "examples"),
    ],
)
def test_the_command_line(tmp_path: Path, arguments: list[str], code: int, word: str) -> None:
    with Program(tmp_path, *arguments) as program:
        assert program.wait() == code, program.output
    assert word in program.output
    assert "Traceback" not in program.output
