"""Lost peers are detected within the lease and found again at once, and late commands are refused."""

import os
import socket
import struct
import threading
import time
from collections.abc import Callable, Collection, Iterator
from contextlib import closing, contextmanager, suppress
from itertools import accumulate
from typing import NamedTuple

from hil.common.clock import now_ns, to_wall_ns
from hil.network.opening import listen, open_session
from hil.network.presence import declare_presence, fetch_last, serve_last, watch_presence
from hil.network.roles import open_master_session
from hil.network.session import Session
from hil.network.settings import Network, settings
from hil.network.tokens import Presence
from hil.ros import encoders as ros
from hil.ros.topics import TOPICS
from hil.slave.command_receiver import CommandReceiver
from tests.support.busy import RunClock
from tests.support.processes import free_port, wait_for
from tools.faults.relay import Relay

AGE_LIMIT_S = 0.3
# Times of a `RunClock`, far from both the usual ones and those that the settings shall avoid.
LOSS_S = 6.0  # usually the lease of 0.8 s; the library's default is 10 s
CUT_S = 6.0  # usually 0.05 s; the lease in that test is 60 s
FOUND_S = 4.0  # usually 0.1 s


class PresenceRecorder:
    """A session that records the appearance and loss of participants, in order, with the time of `clock`."""

    def __init__(self, session: Session, role: str, clock: RunClock) -> None:
        self.session = session
        self.events: list[tuple[float, str, bool]] = []
        self._clock = clock
        watch_presence(session, "uuv1", self._on_presence)
        declare_presence(session, "uuv1", role)  # type: ignore[arg-type]

    def _on_presence(self, presence: Presence, alive: bool) -> None:
        self.events.append((self._clock.seconds, presence.role, alive))

    def time_of(self, role: str, alive: bool, start: int = 0) -> float | None:
        """Return when a participant appeared or was lost, as event number `start` or later; None if it did not."""
        return next((at for at, *event in self.events[start:] if event == [role, alive]), None)


class Peers(NamedTuple):
    """A slave and a master, connected through a relay."""

    slave: PresenceRecorder
    master: PresenceRecorder
    relay: Relay
    clock: RunClock

    def await_events(self, alive: bool, starts: tuple[int, int], meanwhile: Callable[[], object] = int) -> float:
        """Wait until each end has seen the other come or go, as event `starts` or later; return the later time."""

        def times() -> list[float] | None:
            meanwhile()
            times = self.slave.time_of("master", alive, starts[0]), self.master.time_of("slave", alive, starts[1])
            return None if None in times else [at for at in times if at is not None]

        found = wait_for(times)
        assert found, f"not seen as {'present' if alive else 'lost'}: {self.slave.events}, {self.master.events}"
        return max(found)

    def counts(self) -> tuple[int, int]:
        """Return the numbers of events so far."""
        return len(self.slave.events), len(self.master.events)


@contextmanager
def connected_peers(network: Network = Network()) -> Iterator[Peers]:
    port = free_port()
    with (
        RunClock() as clock,
        listen(f"tcp/127.0.0.1:{port}", network) as slave,
        Relay(port) as relay,
        open_master_session(relay.endpoint, network=network) as master,
    ):
        peers = Peers(PresenceRecorder(slave, "slave", clock), PresenceRecorder(master, "master", clock), relay, clock)
        peers.await_events(True, (0, 0))
        yield peers


def test_both_ends_detect_a_silent_link_and_recover() -> None:
    with connected_peers() as peers, closing(CommandReceiver(round(AGE_LIMIT_S * 1e9))) as receiver:
        delays_ns: list[int] = []  # of the commands that were executed
        peers.slave.session.subscribe("uuv1", "cmd_vel", receiver.on_message, 8)
        publisher = peers.master.session.publisher("uuv1", TOPICS["cmd_vel"])

        def command() -> int:
            """Publish a command; return how many commands were executed so far."""
            publisher.put(ros.encode_twist((0.1, 0, 0), (0, 0, 0)), to_wall_ns(now_ns()))
            time.sleep(0.02)
            if taken := receiver.take_latest():
                delays_ns.append(to_wall_ns(taken.received_ns) - taken.published_ns)
            return len(delays_ns)

        assert wait_for(lambda: command() > 20)

        def arrives_late() -> bool:
            """Hold commands for longer than the age limit; return whether they then came. They do if the link lasts."""
            before = receiver.stale
            peers.relay.hold()
            for _ in range(20):
                command()
            peers.relay.release()
            executed = len(delays_ns)
            assert wait_for(lambda: command() > executed + 5)
            return receiver.stale > before

        assert wait_for(arrives_late), "what comes late is refused"
        events, start = peers.counts(), peers.clock.seconds
        peers.relay.hold()
        lost = peers.await_events(False, events, command)
        events, end, executed = peers.counts(), peers.clock.seconds, len(delays_ns)
        peers.relay.release()
        assert wait_for(lambda: command() > executed + 5)
        commanded = peers.clock.seconds
        times = peers.await_events(True, events)
        peers.slave.session.close()
        # Its reader may still handle a command, which needs the receiver's descriptor.
        assert wait_for(lambda: "reader cmd_vel" not in {thread.name for thread in threading.enumerate()})
    assert lost - start < LOSS_S
    assert max(times, commanded) - end < FOUND_S
    # The age is measured against the fastest command so far; a drift of the clocks is allowed for.
    ages_ns = [delay - fastest for delay, fastest in zip(delays_ns, accumulate(delays_ns, min), strict=True)]
    assert max(ages_ns) < (AGE_LIMIT_S + 0.01) * 1e9


def test_cut_links_are_opened_again() -> None:
    with connected_peers(Network(lease=60.0)) as peers:
        events, start = peers.counts(), peers.clock.seconds
        peers.relay.cut()
        lost = peers.await_events(False, events)
        assert lost - start < CUT_S, "a cut is detected before the lease ends"
        time.sleep(0.5)  # several attempts to connect fail
        events, end = peers.counts(), peers.clock.seconds
        peers.relay.accept_again()
        assert peers.await_events(True, events) - end < FOUND_S


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
            assert any(lingering(before)), "else remove `hil.network.workarounds.lingering_socket`"
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
