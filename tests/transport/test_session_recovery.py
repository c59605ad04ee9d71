"""What vanishes is missed within the lease and found again at once; what is late is not obeyed."""

import os
import socket
import struct
import threading
import time
from collections.abc import Iterator
from contextlib import suppress

import pytest

from hil.clock import now_ns, to_wall_ns
from hil.slave.inbox import Inbox
from hil.topics import TOPICS
from hil.transport import ros
from hil.transport.presence import declare_presence, fetch_last, serve_last, watch_presence
from hil.transport.roles import dial
from hil.transport.session import Session, listen, open_session
from hil.transport.settings import Network, settings
from hil.transport.tokens import Presence
from tests.processes import free_port, wait_for
from tests.relay import Relay

AGE_LIMIT_S = 0.3


class End:
    """A session that remembers who came and went, and when."""

    def __init__(self, session: Session, part: str, ident: str = "") -> None:
        self.session = session
        self.seen: list[tuple[float, str, bool]] = []
        watch_presence(session, "uuv1", self._meet)
        declare_presence(session, "uuv1", part, ident)  # type: ignore[arg-type]

    def _meet(self, presence: Presence, alive: bool) -> None:
        self.seen.append((time.monotonic(), presence.part, alive))

    def sees(self, part: str, alive: bool, after: float, within: float) -> float:
        """Seconds from `after` until the news that a part came or went; fails when it takes longer than `within`."""
        found = wait_for(lambda: [at for at, *news in self.seen if news == [part, alive] and at >= after], within + 0.3)
        assert found, f"no {part} {'came' if alive else 'went'} in {self.seen}"
        assert found[0] - after < within
        return found[0] - after


@pytest.fixture
def ends() -> Iterator[tuple[End, End, Relay]]:
    port, began = free_port(), time.monotonic()
    with listen(f"tcp/127.0.0.1:{port}") as slave, Relay(port) as relay, dial(relay.endpoint) as master:
        pair = End(slave, "slave"), End(master, "master")
        pair[0].sees("master", True, began, 3)
        pair[1].sees("slave", True, began, 3)
        yield *pair, relay


def test_a_black_hole_is_seen_by_both_and_data_flow_again(ends: tuple[End, End, Relay]) -> None:
    slave, master, relay = ends
    inbox = Inbox(round(AGE_LIMIT_S * 1e9))
    commanded: list[tuple[float, float]] = []  # sent and taken, both s
    slave.session.subscribe("uuv1", "cmd_vel", inbox.deliver, 8)
    publisher = master.session.publisher("uuv1", TOPICS["cmd_vel"])

    def command(seconds: float) -> None:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            publisher.put(ros.encode_twist((0.1, 0, 0), (0, 0, 0)), to_wall_ns(now_ns()))
            time.sleep(0.02)
            taken = inbox.take()
            if taken:
                commanded.append((taken.published_ns / 1e9, to_wall_ns(taken.received_ns) / 1e9))

    command(0.5)
    assert len(commanded) > 15
    began = time.monotonic()
    relay.hold()
    command(3.0)
    slave.sees("master", False, began, 1.3)
    master.sees("slave", False, began, 1.3)
    during = len(commanded)
    returned = time.monotonic()
    relay.release()
    command(1.0)
    assert len(commanded) > during + 15
    ages = [taken - sent for sent, taken in commanded]
    assert max(ages) < AGE_LIMIT_S, "no command from before the loss is obeyed after it"
    back = commanded[during][1] - (to_wall_ns(now_ns()) / 1e9 - (time.monotonic() - returned))
    assert back < 0.8
    master.sees("slave", True, returned, 0.8)
    slave.sees("master", True, returned, 0.8)
    inbox.close()


def test_cut_links_come_back(ends: tuple[End, End, Relay]) -> None:
    slave, master, relay = ends
    began = time.monotonic()
    relay.cut()
    slave.sees("master", False, began, 0.5)
    master.sees("slave", False, began, 0.5)
    time.sleep(0.5)
    returned = time.monotonic()
    relay.mend()
    master.sees("slave", True, returned, 0.6)
    slave.sees("master", True, returned, 0.6)


def test_a_late_joiner_gets_the_last_state() -> None:
    port = free_port()
    with listen(f"tcp/127.0.0.1:{port}") as slave:
        battery, silent = slave.publisher("uuv1", TOPICS["battery"]), slave.publisher("uuv1", TOPICS["gps"])
        for number in (1, 2):
            battery.put(bytes([number]) * 9, 1000 + number)
        assert silent.last is None
        serve_last(slave, "uuv1")
        got: list[tuple[str, bytes, bytes]] = []
        with dial(f"tcp/127.0.0.1:{port}") as late:

            def ask() -> bool:
                fetch_last(late, "uuv1", lambda *message: got.append(message))
                return bool(got)

            assert wait_for(ask, 3)
    ((topic, payload, attachment),) = got
    assert (topic, payload) == ("battery", b"\2" * 9)
    stamp = ros.unpack_attachment(attachment)
    assert stamp is not None
    assert (stamp.sequence, stamp.time_ns, stamp.gid) == (2, 1002, battery.gid)


def lingering() -> list[bool]:
    """Of each connected TCP socket of this process."""
    found = []
    for name in os.listdir("/proc/self/fd"):
        with suppress(OSError):
            if not os.readlink(f"/proc/self/fd/{name}").startswith("socket:"):
                continue
            with socket.socket(fileno=os.dup(int(name))) as end:
                if end.family == socket.AF_INET and end.getpeername():
                    on, _ = struct.unpack("ii", end.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, 8))
                    found.append(bool(on))
    return found


def test_no_link_lingers() -> None:
    """Closing one whose bytes nobody acknowledges would block a thread that others need."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    before = len(lingering())
    with listen(endpoint) as slave:
        plain = settings("master", (), (endpoint,), Network(), None)
        with open_session("dial", endpoint, plain):
            assert wait_for(lambda: len(lingering()) == before + 4, 3)
            assert any(lingering()), "if the library's links linger no more, ours need not be watched"
            slave.free_links()
            assert wait_for(lambda: not any(lingering()), 1)
            with dial(endpoint):
                assert wait_for(lambda: len(lingering()) == before + 8 and not any(lingering()), 3)
    assert not [thread for thread in threading.enumerate() if thread.name == "errands"]


def test_what_was_said_last_arrives_though_links_do_not_linger() -> None:
    endpoint, heard = f"tcp/127.0.0.1:{free_port()}", list[bytes]()
    with listen(endpoint) as slave:
        slave.subscribe("uuv1", "cmd_vel", lambda _, payload, __: heard.append(payload), 64)
        slave.free_links()
        for number in range(5):
            with dial(endpoint) as master:
                publisher = master.publisher("uuv1", TOPICS["cmd_vel"])
                assert wait_for(lambda: publisher.put(b"first", 0) and b"first" in heard, 3)  # noqa: B023
                publisher.put(b"last of %d" % number, 0)
            assert wait_for(lambda: b"last of %d" % number in heard, 1)  # noqa: B023
            heard.clear()
