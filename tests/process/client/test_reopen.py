"""Reopening a session: after a link that is alive brings no samples, and after failures to open or close."""

import socket
import time
from pathlib import Path
from threading import Event, Thread

import pytest
import zenoh

from hil.client.client import VehicleClient
from hil.common.clock import NS_PER_S
from hil.common.errors import NetworkError
from hil.network import supervisor, token_watch
from hil.network.opening import listen
from hil.network.roles import open_master_session
from hil.network.session import Session
from hil.ros.topics import TOPICS
from tests.support.processes import Program, command_until, free_port, surge_of, wait_for, write_scenario
from tools.faults.relay import Relay

FRAME, FRAGMENT = 0x05, 0x06  # ids of zenoh's transport messages that carry data
KEEP_ALIVE = b"\x01\x00\x04"  # with its length before it; a link that carries data sends none


class SampleBlockingRelay(Relay):
    """A relay that forwards keep-alives, but none of the slave's messages on the link of samples.

    It blocks every connection of a session that was connected while `withholds` was set. So a new connection of that
    session brings no samples, but a new session does.
    """

    withholds = False

    def __init__(self, target: int) -> None:
        self._sessions: dict[socket.socket, bytes] = {}  # by our end towards a client
        self._buffers: dict[socket.socket, bytes] = {}
        self.withheld_from: set[bytes] = set()
        super().__init__(target)

    def _pass(self, end: socket.socket) -> None:
        """Forward the received bytes, and close the link when the client has closed it to open another session."""
        far_end = self._pairs[end] if end not in self._far else end
        near_end = self._pairs[far_end]
        try:
            self._filter(end, near_end, far_end)
        except OSError:
            self._close(far_end, near_end)

    def _filter(self, end: socket.socket, near_end: socket.socket, far_end: socket.socket) -> None:
        is_samples = near_end.getsockname()[1] == self.port + 1
        if end is near_end and near_end not in self._sessions:
            first = near_end.recv(64, socket.MSG_PEEK)
            size = (first[4] >> 4) + 1 if len(first) > 4 else 0  # length, header, version, size of the id and role
            self._sessions[near_end] = first[5 : 5 + size]
        session = self._sessions.get(near_end, b"")
        if self.withholds and session:
            self.withheld_from.add(session)
        if end is near_end or not is_samples:
            super()._pass(end)
            return
        data, withholds = far_end.recv(65536), session in self.withheld_from
        if not data:
            self._close(far_end, near_end)
            return
        data = self._buffers.pop(far_end, b"") + data
        while len(data) >= 2 and len(data) >= (size := 2 + int.from_bytes(data[:2], "little")):
            near_end.sendall(KEEP_ALIVE if withholds and data[2] & 0x1F in (FRAME, FRAGMENT) else data[:size])
            data = data[size:]
        self._buffers[far_end] = data


def test_samples_and_commands_arrive_again_after_a_session_was_reopened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(supervisor, "LEASES", 1)
    monkeypatch.setattr(supervisor, "FIRST_GAP_NS", NS_PER_S // 4)  # a stall is reported after 1.75 s instead of 5 s
    scenario, port = write_scenario(tmp_path)
    reports: list[str] = []
    with (
        Program(tmp_path, "slave", scenario),
        SampleBlockingRelay(port) as relay,
        VehicleClient(relay.endpoint, "uuv1", report=reports.append) as client,
    ):
        assert wait_for(lambda: client.received["odom"] > 10 and relay._sessions)
        relay.withholds = True
        assert wait_for(lambda: relay.withheld_from)
        relay.withholds = False
        assert wait_for(lambda: client.session.openings > 1), reports
        assert client.contact.reconnections
        assert [line for line in reports if "but nothing else came of it" in line and "again" in line]
        before = client.received["odom"]
        assert wait_for(lambda: client.received["odom"] > before + 10 and client.contact.present)
        assert command_until(lambda: surge_of(client) > 0.05, client, surge=0.3), "commands are executed again"


def test_all_declarations_work_after_a_session_was_reopened() -> None:
    with (
        listen(f"tcp/127.0.0.1:{(port := free_port())}") as slave,
        open_master_session(f"tcp/127.0.0.1:{port}") as master,
    ):
        samples: list[bytes] = []
        keys: list[bytes] = []
        commands: list[bytes] = []
        pings: list[bytes] = []
        present: set[str] = set()
        master.subscribe("uuv1", "odom", lambda _topic, payload, _: samples.append(payload), 8)
        master.subscribe_keys("some/**", lambda _key, payload, _: keys.append(payload), 8)
        master.receive("uuv_hil/x", pings.append, 8)
        slave.subscribe("uuv1", "cmd_vel", lambda _topic, payload, _: commands.append(payload), 8)
        slave.watch_tokens("t/*", lambda key, alive: (present.add if alive else present.discard)(key))
        odom, sender = slave.publisher("uuv1", TOPICS["odom"]), slave.sender("some/key")
        ping, command = slave.sender("uuv_hil/x"), master.publisher("uuv1", TOPICS["cmd_vel"])
        master.declare_token("t/stays")
        master.declare_token("t/withdrawn")()

        def exchange() -> bool:
            for received in (samples, keys, commands, pings):
                received.clear()
            odom.put(b"odom", 1)
            sender(b"some")
            ping(b"ping")
            command.put(b"command", 1)
            time.sleep(0.05)
            return bool(samples and keys and commands and pings)

        for number in range(3):
            assert wait_for(exchange)
            assert wait_for(lambda: linked_to(slave) == {opened_zid(master)}), "the links of the old session are closed"
            assert wait_for(lambda: slave.tokens("t/*") == ["t/stays"] and present == {"t/stays"})
            master.reopen()
            assert master.openings == number + 2
        assert wait_for(exchange)


def opened_zid(session: Session) -> str:
    """Return the zenoh id of the library's present session; `Session.zid` is that of the first."""
    return str(session._session.info.zid())


def linked_to(session: Session) -> set[str]:
    return {zid for zid, _, _ in session.links()}


class OverlappingSession:
    """A session of the library that stays open, with its declarations, until `end`."""

    def __init__(self, session: zenoh.Session, declared: list[object]) -> None:
        self._session, self._declared = session, declared

    def close(self) -> None:
        raise zenoh.ZError("close operation timed out!")

    def end(self) -> None:
        self._session.close()  # type: ignore[no-untyped-call]
        self._declared.clear()


def test_a_token_stays_present_when_the_old_session_ends_after_the_new_one_opened() -> None:
    """The watcher gets no event then, because there is always a token with this key."""
    events: list[tuple[str, bool]] = []
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with listen(endpoint) as slave, open_master_session(endpoint) as master:
        slave.watch_tokens("t/*", lambda key, alive: events.append((key, alive)))
        master.declare_token("t/x")
        assert wait_for(lambda: events)
        old_session = OverlappingSession(master._session, [declared.current for declared in master._declared])
        master._session = old_session  # type: ignore[assignment]
        master.reopen()
        assert wait_for(lambda: opened_zid(master) in linked_to(slave))
        assert wait_for(lambda: slave.tokens("t/*") == ["t/x"])
        old_session.end()
        assert wait_for(lambda: linked_to(slave) == {opened_zid(master)})
        assert wait_for(lambda: slave.tokens("t/*") == ["t/x"])
        assert events == [("t/x", True)]
        master.close()
        assert wait_for(lambda: events == [("t/x", True), ("t/x", False)])


def test_a_token_withdrawn_while_the_session_is_reopened_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    """A vehicle that ended meanwhile used to count as present for ever, and its successor as a second one."""
    monkeypatch.setattr(token_watch, "CONFIRM_WITHIN_S", 1.0)
    events: list[tuple[str, bool]] = []
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with listen(endpoint) as slave, open_master_session(endpoint) as master:
        master.watch_tokens("t/*", lambda key, alive: events.append((key, alive)))
        slave.declare_token("t/stays")
        withdraw, open_library = slave.declare_token("t/ends"), master._open_library
        assert wait_for(lambda: len(events) == 2)
        events.clear()

        def open_after_withdrawal() -> zenoh.Session:
            withdraw()
            return open_library()

        master._open_library = open_after_withdrawal
        master.reopen()
        assert wait_for(lambda: ("t/ends", False) in events)
        assert events == [("t/stays", True), ("t/ends", False)]


def test_reopening_a_closed_session_does_nothing() -> None:
    session = open_master_session("tcp/127.0.0.1:9")
    session.close()
    session.reopen()
    assert session.openings == 1
    assert not session.is_lost
    assert session.links() == []


@pytest.mark.parametrize("attempts", [1, 3])
def test_a_session_that_failed_to_open_is_opened_by_a_later_try(attempts: int) -> None:
    with open_master_session("tcp/127.0.0.1:9") as session:
        command, open_library = session.publisher("uuv1", TOPICS["cmd_vel"]), session._open_library
        failures = attempts

        def fail() -> object:
            nonlocal failures
            failures -= 1
            if failures >= 0:
                raise zenoh.ZError("no router")
            return open_library()

        session._open_library = fail  # type: ignore[assignment]
        for _ in range(attempts):
            session.reopen()
            assert session.is_lost
            command.put(b"", 1)  # nothing is sent meanwhile, and nothing raised
        session.reopen()
        assert not session.is_lost
        assert session.openings == 2


def test_clients_can_close_while_a_session_is_reopened() -> None:
    """Opening a session takes long when the router has ended."""
    with open_master_session("tcp/127.0.0.1:9") as session:
        withdraw, open_library, begun, go_on = session.declare_token("t/x"), session._open_library, Event(), Event()

        def open_slowly() -> zenoh.Session:
            begun.set()
            go_on.wait(60.0)
            return open_library()

        session._open_library = open_slowly
        opening = Thread(target=session.reopen)
        opening.start()
        assert begun.wait(60.0)
        ending = Thread(target=withdraw)
        ending.start()
        ending.join(30.0)
        assert not ending.is_alive()
        go_on.set()
        opening.join()
        assert session.openings == 2


def test_a_declaration_on_a_lost_session_is_an_error() -> None:
    with open_master_session("tcp/127.0.0.1:9") as session:
        session._open_library = _fail
        session.reopen()
        with pytest.raises(NetworkError, match=r"no connection to tcp/127\.0\.0\.1:9 at this moment; try again"):
            session.publisher("uuv1", TOPICS["cmd_vel"])


def _fail() -> zenoh.Session:
    raise zenoh.ZError("no router")


class UnclosableSession:
    """A session of the library whose `close` fails."""

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session

    def close(self) -> None:
        self._session.close()  # type: ignore[no-untyped-call]
        raise zenoh.ZError("close operation timed out!")


def test_a_session_whose_close_fails_is_still_reopened() -> None:
    with open_master_session("tcp/127.0.0.1:9") as session:
        for number in range(2):
            session._session = UnclosableSession(session._session)  # type: ignore[assignment]
            session.reopen()
            assert session.openings == number + 2
            assert not session.is_lost
        session._session = UnclosableSession(session._session)  # type: ignore[assignment]
