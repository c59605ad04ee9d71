"""One vehicle with several masters and observers, as real processes and clients."""

import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from hil.autonomy.control.controller import VelocityCommand
from hil.client.client import VehicleClient
from hil.network.roles import open_master_session
from hil.ros import encoders as ros
from hil.ros.diagnostics import or_nan
from hil.ros.topics import TOPICS
from tests.support.busy import RunClock
from tests.support.processes import ROOT, Program, command_until, running_slave, surge_of, wait_for, write_scenario


@pytest.fixture
def slave(tmp_path: Path) -> Iterator[tuple[Program, str]]:
    with running_slave(tmp_path) as started:
        yield started


def figure(client: VehicleClient, name: str) -> int:
    return int(client.diagnostics()[name] or 0)


def command(seconds: float, *clients: VehicleClient) -> None:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        for client in clients:
            client.command(VelocityCommand(surge=0.1))
        time.sleep(0.02)


def test_one_master_commands_at_a_time_beside_any_number_of_observers(slave: tuple[Program, str]) -> None:
    program, endpoint = slave
    with (
        VehicleClient(endpoint, "uuv1") as first,
        VehicleClient(endpoint, "uuv1") as second,
        VehicleClient(endpoint, "uuv1", role="observer") as watching,
    ):
        assert all(client.wait_for_vehicle(60) for client in (first, second, watching))
        assert command_until(lambda: len(first.delays) > 5, first)
        assert command_until(lambda: figure(watching, "commands_refused") > 30, first, second)
        assert command_until(lambda: figure(watching, "commands_taken") > 80, first, second)
        assert command_until(lambda: "another master" in second.refusal(), first, second)
        assert first.refusal() == ""
        assert "--take-over" in second.refusal()
        assert watching.diagnostics().observers == 1
        with VehicleClient(endpoint, "uuv1", rank=1) as third:
            assert third.wait_for_vehicle(60)
            assert command_until(lambda: "another master" in first.refusal(), first, third)
            assert third.refusal() == ""
            taken_commands = figure(third, "commands_taken")
        program.expect("is lost, which commanded")
        assert command_until(lambda: first.refusal() == "", first), "the vehicle is free again"
        assert command_until(lambda: figure(first, "commands_taken") > taken_commands + 50, first)
        assert command_until(lambda: figure(first, "masters_lost") >= 1, first), "a busy machine may lose one more"


def test_a_flood_of_a_second_master_does_not_take_the_vehicle_over(slave: tuple[Program, str]) -> None:
    _, endpoint = slave
    with VehicleClient(endpoint, "uuv1") as first, VehicleClient(endpoint, "uuv1") as second:
        assert first.wait_for_vehicle(60)
        assert command_until(lambda: len(first.delays) > 5, first)

        def is_refused() -> bool:
            for _ in range(40):  # 2000 a second
                second.command(VelocityCommand(surge=-0.1))
            return figure(first, "commands_refused") > 500 and "another master" in second.refusal()

        assert command_until(is_refused, first)
        assert command_until(lambda: is_refused() and surge_of(first) > 0.05, first)
        assert first.refusal() == ""


FLOOD = """
import sys, time, zenoh
from hil.network.roles import open_master_session
from hil.network.tokens import PING, clock_keys

with open_master_session(sys.argv[1]) as session:
    while not session.links():  # the flood would leave a busy machine no time to connect
        time.sleep(0.02)
    ask = session._session.declare_publisher(clock_keys("uuv1")[0], priority=zenoh.Priority.REAL_TIME)
    payload, begin, sent = PING.pack(b"x" * 16, time.time_ns(), 0, 0), time.monotonic(), 0
    while True:
        while sent < (time.monotonic() - begin) * 20_000:
            ask.put(payload)
            sent += 1
            if sent == 2000:
                print("flooding", flush=True)
        time.sleep(0.001)
"""


def test_a_flood_of_pings_by_a_listener_does_not_hide_the_vehicle(slave: tuple[Program, str]) -> None:
    program, endpoint = slave
    with VehicleClient(endpoint, "uuv1") as master, VehicleClient(endpoint, "uuv1", role="observer") as observer:
        assert wait_for(lambda: master.contact.reported and observer.contact.present)
        command = [sys.executable, "-c", FLOOD, endpoint]
        with RunClock() as clock, subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE) as flood:
            try:
                assert flood.stdout
                assert flood.stdout.readline() == b"flooding\n"
                before, start = master.delays.clock.exchanges, clock.seconds
                # Five pings a second; without commands each exchange is one of them.
                assert wait_for(lambda: master.delays.clock.exchanges >= before + 10)
                assert clock.seconds - start < 10.0
                assert wait_for(lambda: master.contact.present and observer.contact.present)
            finally:
                flood.kill()
    assert program.process.poll() is None


def test_clocks_are_compared_continuously_by_both_ends(slave: tuple[Program, str]) -> None:
    """The true values are known on one machine: no offset, no drift."""
    _, endpoint = slave
    with VehicleClient(endpoint, "uuv1") as client:
        assert client.wait_for_vehicle(60)
        clock = client.delays.clock
        assert command_until(lambda: clock.exchanges > 40 and client.contact.reported, client), "traces and pings"

        def is_exact() -> bool:
            """True as soon as one exchange was not held up at either end."""
            offset, values = clock.at(time.time_ns()), client.diagnostics()
            if offset is None or values.clock_offset_ms is None:
                return False
            assert abs(offset.offset_ns) <= offset.uncertainty_ns
            assert abs(values.clock_offset_ms) <= or_nan(values.clock_uncertainty_ms)
            close = offset.uncertainty_ns < 5_000_000 and or_nan(values.clock_uncertainty_ms) < 5
            return close and abs(or_nan(values.clock_drift_ppm)) < 100

        assert command_until(is_exact, client), client.diagnostics()
        assert client.contact.reported is not None
        assert abs(client.contact.reported.offset_ns) <= client.contact.reported.uncertainty_ns


def test_one_session_commands_several_vehicles(tmp_path: Path) -> None:
    folders = [tmp_path / name for name in ("a", "b")]
    endpoints, programs = [], []
    for number, folder in enumerate(folders):
        folder.mkdir()
        scenario, port = write_scenario(folder, slave=f'node = "uuv{number}"')
        programs.append(Program(folder, "slave", scenario))
        endpoints.append(f"tcp/127.0.0.1:{port}")
    with programs[0], programs[1], open_master_session(*endpoints) as session:
        clients = [VehicleClient(session, f"uuv{number}") for number in range(2)]
        assert all(client.wait_for_vehicle(60) for client in clients)
        assert command_until(lambda: all(len(client.delays) > 15 for client in clients), *clients)
        for client in clients:
            client.close()


def test_a_command_from_the_future_or_malformed_changes_nothing(slave: tuple[Program, str]) -> None:
    _, endpoint = slave
    with VehicleClient(endpoint, "uuv1") as client, open_master_session(endpoint) as outsider:
        assert client.wait_for_vehicle(60)
        command(0.3, client)
        forged = outsider.publisher("uuv1", TOPICS["cmd_vel"])
        future = ros.encode_twist((9, 0, 0), (0, 0, 0)), 1 << 62
        for payload, wall_ns in (future, (b"", 0), (b"x" * 100_000, 0), (b"\xff" * 52, 0)):
            before = figure(client, "commands_refused")

            def is_refused(payload: bytes = payload, wall_ns: int = wall_ns, before: int = before) -> bool:
                forged.put(payload, wall_ns)  # again and again: the network may leave out what it cannot send at once
                return figure(client, "commands_refused") > before

            assert command_until(is_refused, client), payload[:60]
        command(1.2, client)
        values = client.diagnostics()
        assert values.commands_malformed == 0, "a refused command is not decoded"
        assert abs(client.get("ground_truth").nu[0]) < 0.5
