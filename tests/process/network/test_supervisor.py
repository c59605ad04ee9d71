"""Recovery from a stalled link: a vehicle that answers but whose samples do not arrive is connected to again."""

import signal
import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
import zenoh

import hil
from hil.client.client import VehicleClient
from hil.client.health_watch import HealthWatch
from hil.common.clock import NS_PER_S
from hil.network import supervisor
from hil.network.opening import listen
from hil.network.presence import watch_nodes
from hil.network.roles import open_client_session, open_master_session
from hil.network.session import Session
from hil.network.sockets import cut
from hil.network.supervisor import Supervisor
from hil.network.workarounds.unread_link import read_progress
from tests.support.processes import Program, free_port, wait_for, write_scenario


@contextmanager
def slow_session(port: int, opened_links: list[str]) -> Iterator[Session]:
    """Provide a master's session whose first link for samples is never read.

    The library never reads a link whose time limit for opening ends while it calls a slow listener.
    """

    def be_slow(event: zenoh.LinkEvent) -> None:
        if event.kind == zenoh.SampleKind.PUT and f":{port + 1}" in event.link.dst:
            opened_links.append(event.link.dst)
            if len(opened_links) == 1:
                time.sleep(0.7)  # the limit is 0.3 s

    with open_master_session(f"tcp/127.0.0.1:{port}") as session:
        listener = session._session.info.declare_link_events_listener(zenoh.handlers.Callback(be_slow, indirect=False))
        yield session
        listener.undeclare()  # type: ignore[no-untyped-call]


def test_samples_arrive_again_when_the_library_does_not_read_a_link(tmp_path: Path) -> None:
    scenario, port = write_scenario(tmp_path)
    reports, opened_links = list[str](), list[str]()
    with (
        slow_session(port, opened_links) as session,
        VehicleClient(session, "uuv1", role="observer", report=reports.append) as client,
        Program(tmp_path, "slave", scenario),
    ):
        assert wait_for(lambda: client.contact.reconnections)
        assert wait_for(lambda: client.received["imu"] > 10 and client.contact.present)
    assert [line for line in reports if "open and not read, or lost; connecting again" in line]
    assert len(opened_links) > 1


def test_samples_arrive_again_without_a_client_too(tmp_path: Path) -> None:
    """Programs that watch a hunt have no client. The library may also lose what is declared on the new link."""
    scenario, port = write_scenario(tmp_path)
    received, opened_links = list[str](), list[str]()
    with slow_session(port, opened_links) as session, Program(tmp_path, "slave", scenario):
        session.subscribe("uuv1", "imu", lambda topic, *_: received.append(topic), 16)
        session.supervisor.watch_presence(lambda: bool(received))
        assert wait_for(lambda: len(opened_links) > 1 and len(received) > 10)


def test_a_client_reconnects_when_the_vehicle_never_appears() -> None:
    """The first declaration may be lost, as happens now and then on a busy machine."""
    endpoint, reports = f"tcp/127.0.0.1:{free_port()}", list[str]()
    with listen(endpoint), VehicleClient(endpoint, "uuv1", role="observer", report=reports.append) as client:
        assert wait_for(lambda: client.contact.reconnections)
        assert [line for line in reports if "had a link, but no answer came of it" in line]
        assert wait_for(lambda: len(client.session.links()) > 0)


def test_a_session_that_looks_for_any_vehicle_reconnects_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(supervisor, "GAPS", 0)  # nothing has come yet, so no gap is usual
    scenario, port = write_scenario(tmp_path)
    endpoint, received = f"tcp/127.0.0.1:{port}", list[str]()
    with ExitStack() as stack:
        with listen(endpoint):  # in the place of a slave whose token is lost
            fleet = stack.enter_context(hil.connect(endpoint, observe=True))
            session = stack.enter_context(open_client_session(endpoint))
            watch = HealthWatch(session)
            plain = stack.enter_context(open_client_session(endpoint))
            watch_nodes(plain)
            plain.subscribe("uuv1", "imu", lambda topic, *_: received.append(topic), 16)
            assert wait_for(lambda: fleet._session.openings > 1 < min(session.openings, plain.openings))
        stack.enter_context(Program(tmp_path, "slave", scenario))
        assert fleet.wait_for("uuv1", seconds=60)
        assert wait_for(lambda: watch.statuses() and received)


def test_a_vehicle_that_ends_behind_a_router_does_not_disturb_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(supervisor, "FIRST_GAP_NS", NS_PER_S // 4)  # a stall is reported after 1.75 s instead of 4 s
    router = f"tcp/127.0.0.1:{free_port()}"
    scenarios = []
    for name in ("uuv1", "uuv2"):
        (tmp_path / name).mkdir()
        scenarios.append(path := write_scenario(tmp_path / name, slave=f'node = "{name}"')[0])
        path.write_text(f'{path.read_text()}\n[network]\nmode = "routed"\nrouter = "{router}"\n')
    with (
        Program(tmp_path, "router", "--listen", router),
        Program(tmp_path, "slave", scenarios[0]),
        hil.connect(router, routed=True, observe=True, wait=60.0) as fleet,
    ):
        with Program(tmp_path, "slave", scenarios[1]) as second:
            staying, leaving = fleet.wait_for("uuv1", "uuv2", seconds=60.0)
            assert second.stop(signal.SIGTERM) == 0
        assert wait_for(lambda: not leaving.present)
        (watched,) = [each for each in fleet._session.supervisor.watched if each.name == "uuv2"]
        lines: list[str] = []
        answers: list[bool] = []  # of the router, on whether it may still run; True without an answer in time
        may_run = watched.may_run

        def ask() -> bool:
            answers.append(may_run())
            return answers[-1]

        monkeypatch.setattr(watched, "report", lines.append)  # gets a line if the session is opened again for it
        monkeypatch.setattr(watched, "may_run", ask)
        before = staying.client.received["odom"]
        assert wait_for(lambda: False in answers)
        assert len(lines) == sum(answers)
        assert wait_for(lambda: staying.present)
        assert wait_for(lambda: staying.client.received["odom"] > before)


def test_a_socket_without_connection_is_not_cut() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
        end.bind(("127.0.0.1", 0))
        cut({(end.getsockname()[1], 0)})
        assert end.getsockname()[1]


def test_the_link_of_a_recorder_is_not_cut() -> None:
    """A recorder has one link, as every session that only subscribes."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with listen(endpoint) as slave, open_client_session(endpoint):
        links = Supervisor(slave, 0.5)
        ends = time.monotonic() + 2.5
        while time.monotonic() < ends:
            assert not links.close_faulty_links()
            time.sleep(0.1)


def test_the_read_progress_of_a_socket_is_measured() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener, socket.create_connection(listener.getsockname()) as client:
        server, _ = listener.accept()
        with server:
            pair = server.getsockname()[1], server.getpeername()[1]
            client.sendall(bytes(1000))
            assert wait_for(lambda: read_progress({pair}) == {pair: 0})
            assert len(server.recv(400)) == 400
            assert read_progress({pair}) == {pair: 400}
            cut({pair})
            assert client.recv(1) == b""
