"""Detection of a vehicle's presence and loss, by a clock of the test."""

from collections.abc import Callable
from typing import Any, cast

import pytest

from hil.client import liveness
from hil.client.liveness import GRACE_S, STALL_S, LivenessMonitor
from hil.common.clock import NS_PER_S
from hil.network import supervisor
from hil.network.clock_offset import ClockOffset
from hil.network.supervisor import Supervisor
from hil.network.tokens import Presence, presence_key

LEASE_S = 0.8


class Clock:
    """A monotonic clock whose waits end by it. `held_up`: when and for how long (s) the process is held up.

    `every` is called at the end of each wait, but not of one in which the process was held up, nor of a short one
    after it: others catch up as slowly.
    """

    def __init__(self) -> None:
        self.now_s = 1000.0
        self.ends_s = self.now_s
        self.held_up: dict[float, float] = {}
        self.every_tick: Callable[[], None] = lambda: None

    def now_ns(self) -> int:
        return round(self.now_s * NS_PER_S)

    def wait(self, seconds: float) -> bool:
        """Wait as the event of closing does; return True at the end."""
        self.now_s += seconds
        late = [at_s for at_s in self.held_up if at_s <= self.now_s]
        self.now_s += sum(self.held_up.pop(at_s) for at_s in late)
        if not late and seconds > STALL_S:
            self.every_tick()
        return self.now_s >= self.ends_s

    def is_set(self) -> bool:
        return False


class FakeSession:
    """A session with links to `peers`. `failures`: so often it cannot be opened again."""

    name = "tcp/bench"
    has_pairs = False
    peer_count = openings = 1
    is_lost = False
    reopened = failures = 0

    def __init__(self, *peers: str) -> None:
        self.supervisor = Supervisor(self, LEASE_S)
        self.peers = peers
        self.reported: list[str] = []  # tokens that a router has

    def links(self) -> list[tuple[str, str, str]]:
        return [(peer, "", "") for peer in self.peers]

    def tokens(self, _keys: str) -> list[str]:
        return self.reported

    def reopen(self) -> bool:
        self.reopened += 1
        self.failures -= 1
        self.is_lost = self.failures >= 0
        self.openings += not self.is_lost
        return not self.is_lost


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    for module in (liveness, supervisor):
        monkeypatch.setattr(module, "now_ns", clock.now_ns)
    return clock


def run(
    clock: Clock,
    seconds: float,
    has_replies: Callable[[], bool],
    samples: Callable[[], bool] = lambda: True,
    session: FakeSession | None = None,
    is_there: bool = True,
) -> list[tuple[float, str]]:
    """Ping for so long a vehicle that is there; it answers and sends samples when that is true.

    Return what was reported, and when.
    """
    reported: list[tuple[float, str]] = []
    began_s, session = clock.now_s, session or FakeSession()
    monitor = LivenessMonitor(
        cast(Any, session),
        "uuv1",
        ClockOffset(),
        lambda: None,
        lambda line: reported.append((clock.now_s - began_s, line)),
        LEASE_S,
    )
    monitor._closing = cast(Any, clock)
    monitor._gid = bytes(16)
    sent: list[bytes] = []
    monitor._send = sent.append
    session.supervisor.watch("uuv1", monitor._arrivals, monitor._on_reconnection, monitor._may_be_running)

    def reply_to_pings() -> None:
        """Reply to the pings that were sent, while this process waits for the next."""
        if sent and has_replies():
            sent.clear()
            monitor._received_ns = clock.now_ns()
            monitor._replies += 1
            monitor._set_present(True)
        monitor.samples += samples()
        session.supervisor.check()

    monitor._set_present(is_there)
    monitor.known.set()
    clock.every_tick, clock.ends_s = reply_to_pings, clock.now_s + seconds
    monitor._ping()
    return reported


def test_the_silence_of_a_vehicle_that_never_answered_counts_from_the_connection(clock: Clock) -> None:
    monitor = LivenessMonitor(cast(Any, FakeSession()), "uuv1", ClockOffset(), lambda: None, print, LEASE_S)
    clock.now_s += 5.0
    assert monitor.silence == "has not answered yet, within 5.0 s"


def test_a_silent_vehicle_is_reported_lost_after_the_lease(clock: Clock) -> None:
    silent_s = clock.now_s + 5.0
    ((at_s, line),) = run(clock, 60.0, lambda: clock.now_s < silent_s)
    assert line == "uuv1 at tcp/bench is lost; trying to connect again"
    assert 5.0 + LEASE_S - 0.2 < at_s < 5.0 + LEASE_S + 2 * GRACE_S


def test_a_lost_vehicle_is_reported_back_with_its_first_reply(clock: Clock) -> None:
    began_s = clock.now_s
    gone, back = run(clock, 60.0, lambda: not 5.0 < clock.now_s - began_s < 10.0)
    assert back[1] == f"uuv1 is back after {back[0] - gone[0]:.1f} s"
    assert 10.0 <= back[0] < 10.4


def test_a_pause_of_this_process_is_not_a_loss_of_the_vehicle(clock: Clock) -> None:
    """A process that is held up sends and reads nothing; the answer to its next ping is the first that can come."""
    began_s = clock.now_s
    clock.held_up = {began_s + 5.0: 0.95, began_s + 10.0: 30.0, began_s + 50.0: 2.0}
    assert run(clock, 60.0, lambda: True) == []


def test_replies_without_samples_reopen_the_session(clock: Clock) -> None:
    session, silent_s = FakeSession("slave"), clock.now_s + 30.0
    reported = run(clock, 90.0, lambda: True, lambda: clock.now_s < silent_s, session)
    assert 2 <= session.reopened <= 8, "each attempt waits longer than the one before"
    assert len(reported) == session.reopened
    assert all("answered, but nothing else came of it" in line for _, line in reported)
    assert 30.0 + 2 * LEASE_S < reported[0][0] < 30.0 + 2 * LEASE_S + 2.0


def test_samples_without_replies_reopen_the_session(clock: Clock) -> None:
    """The peer has lost a part of the declarations: the key of the replies, and perhaps those of other topics."""
    session, silent_s = FakeSession("slave"), clock.now_s + 30.0
    lost, opened, *_ = run(clock, 60.0, lambda: clock.now_s < silent_s, session=session)
    assert "is lost" in lost[1]
    assert "had a link, but no answer came of it" in opened[1]
    assert opened[0] - lost[0] < 2 * LEASE_S + 4.0
    assert session.reopened


@pytest.mark.parametrize(("known_as", "reopens"), [("uuv1", True), ("uuv2", False), ("", True)])
def test_a_silent_vehicle_behind_a_router_reopens_the_session(clock: Clock, known_as: str, reopens: bool) -> None:
    """A router has a link to us whether the vehicle runs or not; a router without its token may have lost it."""
    session, silent_s = FakeSession("router"), clock.now_s + 30.0
    session.reported = [presence_key(Presence(known_as, "slave", 0, "ab", "board:1"))] if known_as else []
    run(clock, 90.0, lambda: clock.now_s < silent_s, lambda: clock.now_s < silent_s, session)
    assert (session.reopened > 0) == reopens


def test_a_failed_reopening_is_retried_at_each_check(clock: Clock) -> None:
    session, silent_s = FakeSession("slave"), clock.now_s + 30.0
    session.failures = 5
    run(clock, 34.0, lambda: True, lambda: clock.now_s < silent_s, session)
    assert session.reopened == 1 + 5


@pytest.mark.parametrize(("peers", "reopens"), [((), False), (("a",), False), (("a", "b"), True)])
def test_a_vehicle_that_never_appeared_reopens_the_session_only_if_all_are_linked(
    clock: Clock, peers: tuple[str, ...], reopens: bool
) -> None:
    """The vehicle may not run; but if each endpoint of the session has a link, one of them is the vehicle."""
    session = FakeSession(*peers)
    session.has_pairs, session.peer_count = True, 2
    run(clock, 20.0, lambda: False, lambda: False, session, is_there=False)
    assert (session.reopened > 0) == reopens
