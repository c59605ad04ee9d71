"""Endpoints on sockets and lines: who is served, who makes room, what is dropped, and what is opened again."""

import argparse
import errno
import socket
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any, cast

import pytest

from hil.common.clock import NS_PER_S
from hil.common.errors import DeviceError, NetworkError
from hil.links.endpoints.lines import WAITING, LineLink, SerialLink, UartPtyLink
from hil.links.endpoints.patient import PatientLink, open_endpoint
from hil.links.endpoints.sockets import (
    HEARTBEATS_NS,
    MAX_PARTNERS,
    RETRY_NS,
    SILENT_NS,
    Link,
    TcpIn,
    TcpOut,
    UdpIn,
    UdpOut,
)
from hil.links.options import add_link
from tests.support.processes import wait_for

HOST, FIRST = "127.0.0.1", b"\xfd\xfe"


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


def test_datagrams_of_few_are_served_and_the_silent_make_room(stack: ExitStack) -> None:
    link = UdpIn(HOST, 0, FIRST, silent_ns=9 * NS_PER_S)
    stack.callback(link.close)
    senders = [stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for _ in range(MAX_PARTNERS + 2)]
    for sender in senders:
        sender.bind((HOST, 0))

    def receive(number: int, now: int, data: bytes = b"\xfd1") -> list[bytes]:
        senders[number].sendto(data, (HOST, link.port))
        return [data for _, data in link.receive(now)]

    assert [receive(0, 0, data) for data in (b"GET /", b"", b"\xfe2", b"GET /")] == [[], [], [b"\xfe2"], [b"GET /"]]
    for number in range(MAX_PARTNERS):
        assert receive(number, number) == [b"\xfd1"]
    assert (receive(MAX_PARTNERS, HEARTBEATS_NS - 1), link.refused) == ([], 1)
    assert (receive(MAX_PARTNERS, HEARTBEATS_NS), link.refused) == ([b"\xfd1"], 1)
    oldest = senders[0].getsockname()
    assert (len(link.partners()), oldest in link.partners()) == (MAX_PARTNERS, False)
    link.tick(9 * NS_PER_S + 1)
    assert senders[1].getsockname() in link.partners()
    link.tick(9 * NS_PER_S + 2)
    assert senders[1].getsockname() not in link.partners()
    link.send(senders[2].getsockname(), b"back")
    assert senders[2].recv(9) == b"back"
    assert link.is_local((HOST, 1))
    assert not link.is_local(("192.168.2.1", 1))


def test_connections_of_few_are_served_and_the_silent_make_room(stack: ExitStack) -> None:
    link = TcpIn(HOST, 0, FIRST)
    stack.callback(link.close)

    def connect() -> socket.socket:
        return stack.enter_context(socket.create_connection((HOST, link.port), 60.0))

    page = connect()
    page.sendall(b"GET / HTTP/1.0\r\n")
    assert wait_for(lambda: not link.receive(0) and page.fileno() >= 0 and _is_closed(page))
    assert link.partners() == []
    calls = []
    for number in range(MAX_PARTNERS):
        calls.append(connect())
        assert wait_for(lambda: len([*link.receive(number), *link.partners()]) > number)  # noqa: B023
    connect()
    assert wait_for(lambda: not link.receive(SILENT_NS) and link.refused == 1)
    calls[0].sendall(b"\xfd1")
    assert wait_for(lambda: any(data == b"\xfd1" for _, data in link.receive(SILENT_NS + 1)))
    newest = connect()
    assert wait_for(lambda: not link.receive(SILENT_NS + 2) and newest.getsockname() in link.partners())
    assert calls[0].getsockname() in link.partners(), "it has sent something"
    assert calls[1].getsockname() not in link.partners(), "the one that is silent for longest"
    link.send(newest.getsockname(), b"hello")
    assert newest.recv(9) == b"hello"


def _is_closed(connection: socket.socket) -> bool:
    connection.settimeout(0.01)
    try:
        return connection.recv(9) == b""
    except TimeoutError:
        return False
    except OSError:
        return True


def test_what_a_connection_does_not_take_waits_up_to_a_limit(stack: ExitStack) -> None:
    link = TcpIn(HOST, 0)
    stack.callback(link.close)
    out = TcpOut(HOST, link.port)
    stack.callback(out.close)
    assert wait_for(lambda: not link.receive(0) and bool(link.partners()))
    (caller,) = link.partners()
    piece, sent = bytes(1 << 16), 0
    while not link._streams[caller].unsent:
        link.send(caller, piece)
        sent += len(piece)
    got = 0

    def all_got() -> bool:
        nonlocal got
        link.tick(0)
        got += sum(len(data) for _, data in out.receive(0))
        return got == sent

    assert wait_for(all_got), (got, sent)
    assert (link.partners(), out.is_lost) == ([caller], False)
    while link.partners():
        link.send(caller, piece)
    assert wait_for(lambda: not out.receive(0) and out.is_lost)
    assert (out.partners(), out.descriptors()) == ([], [])


class Opened(Link):
    """An endpoint that the test loses."""

    name, burst = "opened", 77

    def __init__(self) -> None:
        self.baud, self.closed, self.refused = 0, False, 3

    def descriptors(self) -> list[int]:
        return [5]

    def receive(self, now: int) -> Any:
        return [("there", b"data")]

    def send(self, address: Any, data: bytes) -> None: ...

    def partners(self) -> list[Any]:
        return ["there"]

    def set_baud(self, baud: int) -> None:
        self.baud = baud

    def close(self) -> None:
        self.closed = True


def test_an_endpoint_that_is_lost_is_opened_again_and_that_is_said_once() -> None:
    lines, attempts = list[str](), 0
    results: list[Any] = [OSError(errno.ECONNREFUSED, "refused"), OSError(errno.ECONNREFUSED, "refused"), Opened()]

    def opener() -> Link:
        nonlocal attempts
        attempts += 1
        result = results[attempts - 1]
        if isinstance(result, OSError):
            raise result
        return cast(Link, result)

    def tick(now: int) -> None:
        link.tick(now)
        link._thread.join()

    link = PatientLink("tcpout:x", opener, lines.append)
    link.set_baud(57_600)
    assert (link.descriptors(), link.receive(0), link.partners()) == ([], [], [])
    for now, count in ((RETRY_NS - 1, 1), (RETRY_NS, 2), (RETRY_NS + 1, 2), (2 * RETRY_NS, 2), (2 * RETRY_NS + 1, 3)):
        tick(now)
        assert attempts == count, now
    tick(3 * RETRY_NS)
    first = results[2]
    assert (link.partners(), link.burst, first.baud) == (["there"], 77, 57_600)
    assert lines == ["tcpout:x: waiting for it: refused", "tcpout:x: is open"]
    tick(4 * RETRY_NS)
    assert (link.refused, first.refused) == (3, 0)
    first.is_lost = True
    results.append(Opened())
    tick(5 * RETRY_NS)
    assert (first.closed, link.partners(), attempts) == (True, [], 3)
    tick(5 * RETRY_NS)
    tick(5 * RETRY_NS)
    assert (link.partners(), attempts, len(lines)) == (["there"], 4, 2)


def test_a_taken_port_is_a_fault_that_waiting_does_not_mend() -> None:
    def opener() -> Link:
        raise OSError(errno.EADDRINUSE, "Address already in use")

    with pytest.raises(NetworkError, match="choose another endpoint"):
        PatientLink("udpin:x", opener, print)


class Wire:
    """A wire whose unsent bytes the test sets."""

    name, waits, broken = "/dev/bench", 0, False

    def __init__(self) -> None:
        self.written: list[bytes] = []

    def read(self) -> bytes:
        if self.broken:
            raise DeviceError("gone")
        return b"data"

    def write(self, data: bytes) -> int:
        self.read()
        self.written.append(data)
        return len(data)

    def unsent(self) -> int:
        return self.waits


class Line(LineLink):
    """A line that records its speed."""

    def __init__(self, wire: Wire) -> None:
        self.speeds: list[int] = []
        super().__init__("serial:bench", cast(Any, wire), 115_200)

    def _use_baud(self, baud: int) -> None:
        self.speeds.append(baud)


def test_a_line_loses_whole_messages_and_changes_its_speed_when_all_is_sent() -> None:
    wire = Wire()
    line = Line(wire)
    for wire.waits in (WAITING - 4, WAITING - 3):
        line.send("", b"four")
    assert (wire.written, line.lost_messages) == ([b"four"], 1)
    line.set_baud(9600)
    assert line.speeds == []
    wire.waits = 0
    line.tick(0)
    line.tick(0)
    assert line.speeds == [9600]
    assert (line.receive(0), line.is_lost) == ([("/dev/bench", b"data")], False)
    wire.broken = True
    assert (line.receive(0), line.is_lost) == ([], True)
    line.is_lost = False
    line.send("", b"four")
    assert line.is_lost


def test_a_host_that_is_silent_is_looked_up_again(stack: ExitStack, monkeypatch: pytest.MonkeyPatch) -> None:
    there = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
    there.bind((HOST, 0))
    there.settimeout(60.0)
    port, address, asked = there.getsockname()[1], HOST, list[str]()

    def look_up(host: str, port: int, **_: Any) -> list[Any]:
        asked.append(host)
        return [(socket.AF_INET, socket.SOCK_DGRAM, 0, "", (address, port))]

    monkeypatch.setattr(socket, "getaddrinfo", look_up)
    named, numbered = UdpOut("board", port), UdpOut(HOST, port)
    for link in (named, numbered):
        stack.callback(link.close)
        assert link.partners() == [(HOST, port)]
        assert (link.receive(3), len(link.descriptors()), link.is_local((HOST, port))) == ([], 1, True)
        link.tick(3 + SILENT_NS)
        link.send((HOST, port), b"out")
        data, sender = there.recvfrom(9)
        there.sendto(b"back", sender)
        assert data == b"out"
        assert wait_for(lambda: link.receive(5) == [((HOST, port), b"back")])  # noqa: B023
        for now in (5 + SILENT_NS, 6 + SILENT_NS, 7 + SILENT_NS):
            link.tick(now)
            assert wait_for(lambda: len(asked) == 2 + (link is named and now > 5 + SILENT_NS) or link is numbered)  # noqa: B023
    assert asked == ["board", HOST, "board"]
    assert not named.is_lost
    address = "127.0.0.2"
    named.tick(7 + 2 * SILENT_NS)
    assert wait_for(lambda: named.is_lost)
    there.close()
    for _ in range(3):
        numbered.send((HOST, port), b"to nobody")
    assert not numbered.is_lost, "it may be started yet"
    numbered.close()
    numbered.send((HOST, port), b"x")
    assert numbered.is_lost


@pytest.mark.parametrize(("baud", "burst"), [(57_600, 300), (921_600, 921)])
def test_a_line_is_opened_by_its_name_and_paced(tmp_path: Path, stack: ExitStack, baud: int, burst: int) -> None:
    path = str(tmp_path / "line")
    link = open_endpoint("pty", path, baud, print)
    stack.callback(link.close)

    def is_open() -> bool:
        link.tick(0)
        return bool(link.partners())

    assert wait_for(is_open)
    program = SerialLink(path, baud)
    stack.callback(program.close)
    assert (link.name, link.burst, program.burst) == (f"pty:{path}:{baud}", burst, burst)
    program.send("", b"in")
    assert wait_for(lambda: link.receive(0) == [(path, b"in")])
    link.send("", b"out")
    assert wait_for(lambda: not link.receive(0) and program.receive(0) == [(path, b"out")])
    assert (link.is_local(path), len(link.descriptors())) == (True, 1)


def test_a_program_at_another_speed_reads_rubbish(tmp_path: Path, stack: ExitStack) -> None:
    path = str(tmp_path / "line")
    line = UartPtyLink(path, 9600, b"U")
    program = SerialLink(path, 19_200)
    for link in (program, line):
        stack.callback(link.close)
    for data, arrives, baud in ((b"\x00", b"\xf8", 9600), (b"Ux", b"Ux", 19_200)):
        program.send("", data)
        assert wait_for(lambda: line.receive(0) == [(path, arrives)])  # noqa: B023
        assert line._line.faults.baud == baud
    line.set_baud(38_400)
    assert line._line.faults.baud == 38_400
    line.send("", b"\x00")
    assert wait_for(lambda: not line.receive(0) and program.receive(0) == [(path, b"\xf8")])
    program.set_baud(38_400)
    line.send("", b"\x00")
    assert wait_for(lambda: not line.receive(0) and program.receive(0) == [(path, b"\x00")])


def test_the_options_of_a_link_have_their_defaults() -> None:
    parser = argparse.ArgumentParser()
    add_link(parser, "pty:")
    assert vars(parser.parse_args([])) == {
        "port": "pty:", "protocol": "frame", "frame": "uuv_hil", "option": [], "baud": 115_200, "bitrate": 1_000_000,
        "channels": 6,
    }  # fmt: skip
    given = ["--port", "/dev/x", "--option", "a=1", "--option", "b=2", "--baud", "9600", "--channels", "16"]
    options = parser.parse_args(given)
    assert (options.port, options.option, options.baud, options.channels) == ("/dev/x", ["a=1", "b=2"], 9600, 16)
