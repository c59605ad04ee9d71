"""Lost peers are detected within the lease and found again at once, and late commands are refused."""

import os
import socket
import struct
import threading
import time
from collections.abc import Collection, Iterator
from contextlib import suppress

import pytest

from hil.common.clock import from_wall_ns, now_ns, to_wall_ns
from hil.network.opening import listen, open_session
from hil.network.presence import declare_presence, fetch_last, serve_last, watch_presence
from hil.network.roles import open_master_session
from hil.network.session import Session
from hil.network.settings import Network, settings
from hil.network.tokens import Presence
from hil.ros import encoders as ros
from hil.ros.topics import TOPICS
from hil.slave.command_receiver import CommandReceiver
from tests.support.busy import retry_when_busy
from tests.support.processes import free_port, wait_for
from tools.faults.relay import Relay

AGE_LIMIT_S = 0.3


class PresenceRecorder:
    """A session that records the appearance and loss of parts with their times."""

    def __init__(self, session: Session, role: str, ident: str = "") -> None:
        self.session = session
        self.events: list[tuple[float, str, bool]] = []
        watch_presence(session, "uuv1", self._on_presence)
        declare_presence(session, "uuv1", role, ident)  # type: ignore[arg-type]

    def _on_presence(self, presence: Presence, alive: bool) -> None:
        self.events.append((time.monotonic(), presence.part, alive))

    def wait_for_role(self, role: str, alive: bool, after: float) -> float:
        """Return the seconds from `after` until a part appeared or was lost."""
        found = wait_for(lambda: [at for at, *wakeup in self.events if wakeup == [role, alive] and at >= after])
        assert found, f"no {role} {'came' if alive else 'went'} in {self.events}"
        return found[0] - after


@pytest.fixture
def peers() -> Iterator[tuple[PresenceRecorder, PresenceRecorder, Relay]]:
    port, start = free_port(), time.monotonic()
    with listen(f"tcp/127.0.0.1:{port}") as slave, Relay(port) as relay, open_master_session(relay.endpoint) as master:
        pair = PresenceRecorder(slave, "slave"), PresenceRecorder(master, "master")
        pair[0].wait_for_role("master", True, start)
        pair[1].wait_for_role("slave", True, start)
        yield *pair, relay


def test_both_ends_detect_a_silent_link_and_recover(peers: tuple[PresenceRecorder, PresenceRecorder, Relay]) -> None:
    slave, master, relay = peers
    command_receiver = CommandReceiver(round(AGE_LIMIT_S * 1e9))
    commanded: list[tuple[float, float]] = []  # sent and received, both s
    slave.session.subscribe("uuv1", "cmd_vel", command_receiver.on_message, 8)
    publisher = master.session.publisher("uuv1", TOPICS["cmd_vel"])

    def command(seconds: float) -> int:
        """Publish commands for some seconds; return how many of them were executed."""
        before, end = len(commanded), time.monotonic() + seconds
        while time.monotonic() < end:
            publisher.put(ros.encode_twist((0.1, 0, 0), (0, 0, 0)), to_wall_ns(now_ns()))
            time.sleep(0.02)
            command = command_receiver.take_latest()
            if command:
                commanded.append((command.published_ns / 1e9, command.received_ns / 1e9))
        return len(commanded) - before

    def check_loss_and_recovery() -> None:
        assert wait_for(lambda: command(0.3) > 2)
        start = time.monotonic()
        relay.hold()
        command(3.0)
        missed = slave.wait_for_role("master", False, start), master.wait_for_role("slave", False, start)
        returned, during = time.monotonic(), len(commanded)
        relay.release()
        assert wait_for(lambda: command(0.3) > 2)
        durations = master.wait_for_role("slave", True, returned), slave.wait_for_role("master", True, returned)
        assert all(taken - to_monotonic(sent) < AGE_LIMIT_S for sent, taken in commanded), "none from before it"
        assert max(missed) < 1.3
        assert commanded[during][1] - returned < 0.8
        assert max(durations) < 0.8

    retry_when_busy(check_loss_and_recovery, "seconds of two sessions and a relay, in threads of one process")
    slave.session.close()
    # Its reader may still handle a command, which needs the receiver's descriptor.
    assert wait_for(lambda: "reader cmd_vel" not in {thread.name for thread in threading.enumerate()})
    command_receiver.close()


def to_monotonic(wall_s: float) -> float:
    return from_wall_ns(round(wall_s * 1e9)) / 1e9


def test_cut_links_are_opened_again(peers: tuple[PresenceRecorder, PresenceRecorder, Relay]) -> None:
    slave, master, relay = peers

    def check_cut_and_recovery() -> None:
        began = time.monotonic()
        relay.cut()
        missed = slave.wait_for_role("master", False, began), master.wait_for_role("slave", False, began)
        time.sleep(0.5)
        returned = time.monotonic()
        relay.accept_again()
        found = master.wait_for_role("slave", True, returned), slave.wait_for_role("master", True, returned)
        assert max(missed) < 0.5
        assert max(found) < 0.6

    retry_when_busy(check_cut_and_recovery, "seconds of two sessions and a relay, in threads of one process")


def test_a_late_client_gets_the_last_state() -> None:
    port = free_port()
    with listen(f"tcp/127.0.0.1:{port}") as slave:
        battery, silent = slave.publisher("uuv1", TOPICS["battery"]), slave.publisher("uuv1", TOPICS["gps"])
        for number in (1, 2):
            battery.put(bytes([number]) * 9, 1000 + number)
        assert silent.last is None
        serve_last(slave, "uuv1")
        received: list[tuple[str, bytes, bytes]] = []
        with open_master_session(f"tcp/127.0.0.1:{port}") as late_session:

            def ask() -> bool:
                fetch_last(late_session, "uuv1", lambda *message: received.append(message))
                return bool(received)

            assert wait_for(ask)
    ((topic, payload, attachment),) = received
    assert (topic, payload) == ("battery", b"\2" * 9)
    stamp = ros.unpack_attachment(attachment)
    assert stamp is not None
    assert (stamp.sequence, stamp.time_ns, stamp.gid) == (2, 1002, battery.gid)


def sockets() -> dict[str, str]:
    """Return the open sockets of this process by descriptor."""
    delays = {}
    for name in os.listdir("/proc/self/fd"):
        with suppress(OSError):
            delays[name] = os.readlink(f"/proc/self/fd/{name}")
    return {name: place for name, place in delays.items() if place.startswith("socket:")}


def lingering(besides: Collection[str]) -> list[bool]:
    """Return for each connected TCP socket of this process, except those in `besides`, whether it has SO_LINGER set."""
    received = []
    for name, place in sockets().items():
        with suppress(OSError):
            if place in besides:
                continue
            with socket.socket(fileno=os.dup(int(name))) as end:
                if end.family == socket.AF_INET and end.getpeername():
                    on, _ = struct.unpack("ii", end.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, 8))
                    received.append(bool(on))
    return received


def test_no_link_has_linger_set() -> None:
    """Closing a link with unacknowledged bytes would otherwise block a thread of the library."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    before = sockets().values()
    with listen(endpoint) as slave:
        plain = settings("master", (), (endpoint,), Network(), None)
        with open_session("connect to", endpoint, plain):
            assert wait_for(lambda: len(lingering(before)) == 4)
            assert any(lingering(before)), "if the library's links linger no more, ours need not be watched"
            slave.free_links()
            assert wait_for(lambda: not any(lingering(before)))
            with open_master_session(endpoint):
                assert wait_for(lambda: len(lingering(before)) == 8 and not any(lingering(before)))
    assert wait_for(lambda: not [thread for thread in threading.enumerate() if thread.name == "worker"])


def test_the_last_message_arrives_although_links_do_not_linger() -> None:
    endpoint, received = f"tcp/127.0.0.1:{free_port()}", list[bytes]()
    with listen(endpoint) as slave:
        slave.subscribe("uuv1", "cmd_vel", lambda _, payload, __: received.append(payload), 64)
        slave.free_links()
        for number in range(5):
            with open_master_session(endpoint) as master:
                publisher = master.publisher("uuv1", TOPICS["cmd_vel"])
                assert wait_for(lambda: publisher.put(b"first", 0) and b"first" in received)  # noqa: B023
                publisher.put(b"last of %d" % number, 0)
            assert wait_for(lambda: b"last of %d" % number in received)  # noqa: B023
            received.clear()
