"""One vehicle and several who want something of it: as processes and clients, over the whole way."""

import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from hil.autonomy.control import VelocityCommand
from hil.commands.keys import add_machine, init
from hil.master.client import VehicleClient
from hil.topics import TOPICS
from hil.transport import ros
from hil.transport.roles import dial
from tests.processes import ROOT, Program, wait_for, write_scenario


@pytest.fixture
def slave(tmp_path: Path) -> Iterator[tuple[Program, str]]:
    scenario, port = write_scenario(tmp_path)
    with Program(tmp_path, "slave", scenario) as program:
        program.expect("ready")
        yield program, f"tcp/127.0.0.1:{port}"


def command(seconds: float, *clients: VehicleClient) -> None:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        for client in clients:
            client.command(VelocityCommand(surge=0.1))
        time.sleep(0.02)


def figure(client: VehicleClient, name: str) -> int:
    return int(client.diagnostics()[name])


def test_one_master_at_a_time_and_any_number_of_observers(slave: tuple[Program, str]) -> None:
    program, endpoint = slave
    with (
        VehicleClient(endpoint, "uuv1") as first,
        VehicleClient(endpoint, "uuv1") as second,
        VehicleClient(endpoint, "uuv1", part="observer") as watching,
    ):
        assert all(client.wait_for_vehicle(5) for client in (first, second, watching))
        command(0.5, first)
        command(2.3, first, second)
        assert first.refusal() == ""
        assert "another master" in second.refusal()
        assert "--take-over" in second.refusal()
        assert figure(watching, "commands_refused") > 30
        assert figure(watching, "commands_taken") > 80
        assert watching.diagnostics()["observers"] == "1"
        with VehicleClient(endpoint, "uuv1", rank=1) as third:
            assert third.wait_for_vehicle(5)
            command(2.3, first, third)
            assert third.refusal() == ""
            assert "another master" in first.refusal()
            taken = figure(third, "commands_taken")
        program.expect("is gone, which commanded")
        command(2.3, first)
        assert first.refusal() == "", "the vehicle is free again"
        assert figure(first, "commands_taken") > taken + 50
        assert figure(first, "masters_lost") == 1


def test_a_silent_master_gives_way(slave: tuple[Program, str]) -> None:
    _, endpoint = slave
    with VehicleClient(endpoint, "uuv1") as first, VehicleClient(endpoint, "uuv1") as second:
        assert first.wait_for_vehicle(5)
        assert second.wait_for_vehicle(5)
        command(0.3, first)
        time.sleep(0.6)  # longer than the deadman's 0.5 s
        before = len(second.delays)
        command(0.5, second)
        assert wait_for(lambda: len(second.delays) > before + 15, 2)


def test_a_flood_of_commands_is_thinned(slave: tuple[Program, str]) -> None:
    program, endpoint = slave
    with VehicleClient(endpoint, "uuv1") as client:
        assert client.wait_for_vehicle(5)
        end = time.monotonic() + 2.5
        sent = 0
        while time.monotonic() < end:
            sent = client.command(VelocityCommand(surge=0.1))
        assert sent > 5000
        time.sleep(1.1)
        values = client.diagnostics()
        assert int(values["commands_received"]) < 200 * 4, "command_rate is 200 Hz"
        assert int(values["commands_flooded"]) > 100
    assert program.process.poll() is None


def test_a_flood_of_another_does_not_take_the_vehicle(slave: tuple[Program, str]) -> None:
    _, endpoint = slave
    with VehicleClient(endpoint, "uuv1") as first, VehicleClient(endpoint, "uuv1") as second:
        assert first.wait_for_vehicle(5)
        command(0.5, first)
        end = time.monotonic() + 2.5
        while time.monotonic() < end:
            for _ in range(40):  # 2000 a second
                second.command(VelocityCommand(surge=-0.1))
            command(0.02, first)
        assert first.refusal() == ""
        assert "another master" in second.refusal()
        assert first.get("ground_truth").nu[0] > 0.05
        assert figure(first, "commands_refused") > 500


FLOOD = """
import sys, time, zenoh
from hil.transport.roles import dial
from hil.transport.tokens import PING, clock_keys

with dial(sys.argv[1]) as session:
    ask = session._session.declare_publisher(clock_keys("uuv1")[0], priority=zenoh.Priority.REAL_TIME)
    payload, begin, sent = PING.pack(b"x" * 16, time.time_ns(), 0, 0), time.monotonic(), 0
    while True:
        while sent < (time.monotonic() - begin) * 20_000:
            ask.put(payload)
            sent += 1
        time.sleep(0.001)
"""


def test_a_flood_of_pings_by_one_that_may_only_listen_hides_the_vehicle_from_nobody(slave: tuple[Program, str]) -> None:
    program, endpoint = slave
    with VehicleClient(endpoint, "uuv1") as master, VehicleClient(endpoint, "uuv1", part="observer") as observer:
        assert wait_for(lambda: master.contact.told and observer.contact.present, 5)
        with subprocess.Popen([sys.executable, "-c", FLOOD, endpoint], cwd=ROOT) as flood:
            try:
                assert wait_for(lambda: int(master.diagnostics().get("pings_dropped", 0)), 5)
                before = master.delays.clock.exchanges
                time.sleep(4.0)  # 20 pings; without commands each exchange is one of them
                answered = master.delays.clock.exchanges - before
            finally:
                flood.kill()
        assert answered >= 14
        assert master.contact.losses == observer.contact.losses == 0
    assert program.process.poll() is None


def test_clocks_are_compared_all_the_time_and_by_both(slave: tuple[Program, str]) -> None:
    """On one machine the truth is known: no offset, no drift."""
    _, endpoint = slave
    with VehicleClient(endpoint, "uuv1") as client:
        assert client.wait_for_vehicle(5)
        command(2.2, client)
        ours = client.delays.clock
        assert ours.exchanges > 40, "traces and pings"
        found = ours.at(time.time_ns())
        assert found is not None
        assert abs(found.offset_ns) <= found.uncertainty_ns < 5_000_000
        values = client.diagnostics()
        assert abs(float(values["clock_offset_ms"])) <= float(values["clock_uncertainty_ms"]) < 5
        assert float(values["clock_drift_ppm"]) == pytest.approx(0.0, abs=100)
        assert client.contact.told is not None
        assert abs(client.contact.told.offset_ns) <= client.contact.told.uncertainty_ns


def test_a_late_joiner_has_slow_topics_at_once(slave: tuple[Program, str]) -> None:
    _, endpoint = slave
    time.sleep(0.2)
    began = time.monotonic()
    with VehicleClient(endpoint, "uuv1") as late:
        assert wait_for(late.diagnostics, 0.7), "published once a second"
        assert time.monotonic() - began < 0.7
        assert late.latest["diagnostics"].age_s < 1.5


def test_one_session_for_several_vehicles(tmp_path: Path) -> None:
    folders = [tmp_path / name for name in ("a", "b")]
    endpoints, programs = [], []
    for number, folder in enumerate(folders):
        folder.mkdir()
        scenario, port = write_scenario(folder, slave=f'node = "uuv{number}"')
        programs.append(Program(folder, "slave", scenario))
        endpoints.append(f"tcp/127.0.0.1:{port}")
    with programs[0], programs[1], dial(*endpoints) as session:
        clients = [VehicleClient(session, f"uuv{number}") for number in range(2)]
        assert all(client.wait_for_vehicle(5) for client in clients)
        command(0.5, *clients)
        assert all(len(client.delays) > 15 for client in clients)
        for client in clients:
            client.close()


def test_a_command_for_the_future_or_without_sense_changes_nothing(slave: tuple[Program, str]) -> None:
    _, endpoint = slave
    with VehicleClient(endpoint, "uuv1") as client, dial(endpoint) as stranger:
        assert client.wait_for_vehicle(5)
        command(0.3, client)
        forged = stranger.publisher("uuv1", TOPICS["cmd_vel"])
        for _ in range(5):
            forged.put(ros.encode_twist((9, 0, 0), (0, 0, 0)), 1 << 62)
            command(0.1, client)
        for payload in (b"", b"x" * 100_000, b"\xff" * 52):
            forged.put(payload, 0)
            command(0.05, client)
        command(1.2, client)
        values = client.diagnostics()
        assert values["commands_refused"] == "8", "who is refused is not even read"
        assert values["commands_malformed"] == "0"
        assert abs(client.get("ground_truth").nu[0]) < 0.5


SECURITY = """
[security]
slave = "keys/uuv1"
master = "keys/{master}"
may_command = ["laptop"]
may_listen = ["viewer"]
"""


def test_the_refused_master_is_told_why(tmp_path: Path) -> None:
    init(str(tmp_path / "keys"))
    for name in ("uuv1", "laptop", "viewer", "stranger"):
        add_machine(str(tmp_path / "keys"), name, [])
    plain, port = write_scenario(tmp_path)
    text = plain.read_text()
    arguments = ("--connect", f"tcp/127.0.0.1:{port}", "--wait", 3, "--run-dir", tmp_path / "run")
    said = {"viewer": "may_command", "stranger": "may_listen does not name 'stranger'", "": "wants a certificate"}
    scenarios = {}
    for name in ("laptop", *said):
        scenarios[name] = tmp_path / f"{name or 'none'}.toml"
        scenarios[name].write_text(text + (SECURITY.format(master=name) if name else ""))
    with Program(tmp_path, "slave", scenarios["laptop"]) as slave:
        slave.expect("ready")
        running = {name: Program(tmp_path, "master", scenarios[name], *arguments) for name in said}
        for name, words in said.items():
            with running[name] as master:
                assert master.wait(20) == 4, master.output
                assert words in master.output
                assert "Traceback" not in master.output
        with Program(tmp_path, "master", scenarios["laptop"], *arguments) as master:
            master.expect("flying")
        assert "Traceback" not in slave.output
