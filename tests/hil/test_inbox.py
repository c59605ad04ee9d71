"""Commands: the newest counts, old and broken ones are dropped and counted."""

import select
import time
from collections import deque
from collections.abc import Iterator

import pytest

from hil.autonomy.control import VelocityCommand
from hil.clock import now_ns, to_wall_ns
from hil.slave import inbox as module
from hil.slave.inbox import AgeFilter, Inbox
from hil.transport import ros
from hil.transport.clock_offset import ClockOffset
from hil.transport.ros_commands import encode_number

GID, OTHER = bytes(range(16)), bytes(16)
MS = 1_000_000
HOLD_MS = 500  # of an inbox that is told nothing else


class Clock:
    """Passes only when told, and when somebody sleeps."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_ns = 10**12
        self.slept: list[float] = []
        monkeypatch.setattr(module, "now_ns", lambda: self.now_ns)
        monkeypatch.setattr(time, "sleep", self.sleep)

    def sleep(self, seconds: float) -> None:
        self.slept.append(seconds)
        self.wait(seconds * 1000)

    def wait(self, milliseconds: float) -> None:
        self.now_ns += round(milliseconds * MS)

    def deliver(
        self, inbox: Inbox, sequence: int, gid: bytes = GID, age_ms: float = 0.0, topic: str = "cmd_vel"
    ) -> bool:
        """Whether it is obeyed."""
        stamp = ros.pack_attachment(sequence, to_wall_ns(self.now_ns) - round(age_ms * MS), gid)
        inbox.deliver(topic, ros.encode_twist((0.5, 0, 0), (0, 0, 0)), stamp)
        return inbox.take() is not None


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    return Clock(monkeypatch)


@pytest.fixture
def inbox() -> Iterator[Inbox]:
    inbox = Inbox(age_limit_ns=100 * MS)
    yield inbox
    inbox.close()


def deliver(inbox: Inbox, sequence: int, surge: float = 0.5, age_ms: float = 0.0, gid: bytes = GID) -> None:
    sent = to_wall_ns(now_ns()) - round(age_ms * MS)
    inbox.deliver("cmd_vel", ros.encode_twist((surge, 0, 0), (0, 0, 0)), ros.pack_attachment(sequence, sent, gid))


def test_a_command_wakes_and_is_taken_once(inbox: Inbox) -> None:
    assert inbox.take() is None
    deliver(inbox, 1, surge=0.7)
    assert select.select((inbox,), (), (), 0)[0]
    taken = inbox.take()
    assert taken is not None
    assert isinstance(taken.command, VelocityCommand)
    assert taken.command.surge == pytest.approx(0.7)
    assert taken.sequence == 1
    assert inbox.take() is None
    assert not select.select((inbox,), (), (), 0)[0]


def test_the_newest_wins(inbox: Inbox) -> None:
    for sequence in (1, 2, 3):
        deliver(inbox, sequence, surge=sequence / 10)
    taken = inbox.take()
    assert taken is not None
    assert taken.sequence == 3
    assert inbox.superseded == 2


def test_a_command_that_nobody_took_in_time_is_dropped(inbox: Inbox) -> None:
    deliver(inbox, 1)
    time.sleep(0.12)  # longer than its limit
    assert inbox.take() is None
    assert inbox.stale == 1


def test_another_master_is_refused_until_this_one_is_silent(inbox: Inbox) -> None:
    deliver(inbox, 1)
    deliver(inbox, 1, gid=OTHER)
    assert (inbox.master, inbox.refused) == (GID, 1)
    taken = inbox.take()
    assert taken is not None
    inbox.forget(GID)
    deliver(inbox, 2, gid=OTHER)
    assert inbox.master == OTHER
    inbox.ranks[GID] = 1
    deliver(inbox, 2)
    assert inbox.master == GID, "a higher rank takes over at once"
    deliver(inbox, 3, gid=OTHER)
    assert inbox.refused == 2
    assert inbox.news.is_set()


def test_who_commanded_before_it_was_known_and_left_is_followed_by_one_master(inbox: Inbox) -> None:
    deliver(inbox, 1)
    inbox.ranks[GID] = 0
    inbox.forget(GID)
    inbox.deliver("cmd_depth", encode_number(2.0), ros.pack_attachment(1, to_wall_ns(now_ns()), OTHER))
    assert inbox.master == OTHER


def test_a_stale_command_gives_no_right(inbox: Inbox) -> None:
    deliver(inbox, 1)
    inbox.forget(GID)
    deliver(inbox, 2, age_ms=3000)
    assert inbox.master == b""


def test_an_exact_clock_judges_even_the_first_command(inbox: Inbox) -> None:
    """Without one the fastest message so far stands for age zero, and the first has nothing before it."""
    clock = ClockOffset()
    now = to_wall_ns(now_ns())
    clock.add(now, now + 3600 * 10**9, now + 3600 * 10**9, now)  # the master is an hour ahead
    inbox.clocks[GID] = clock
    deliver(inbox, 1, age_ms=-3_600_000 + 1000)
    assert (inbox.stale, inbox.take()) == (1, None)
    deliver(inbox, 2, age_ms=-3_600_000)
    assert inbox.take() is not None


def test_a_flood_lets_the_reader_rest(inbox: Inbox) -> None:
    began = time.monotonic()
    for sequence in range(1, 61):
        deliver(inbox, sequence)
    assert 0.15 < time.monotonic() - began < 1.0, "60 commands at 200 a second, less a burst of a tenth"
    assert inbox.flooded > 30


@pytest.mark.parametrize("rate", [300, 20_000])
@pytest.mark.parametrize("known", [False, True], ids=["strangers", "masters"])
def test_a_flood_of_who_is_refused_neither_hides_the_master_nor_replaces_it(
    inbox: Inbox, clock: Clock, rate: int, known: bool
) -> None:
    """What has come while the reader rested waits in a ring of eight, as on the network."""
    if known:
        inbox.ranks.update({GID: 0, OTHER: 0})
    ring: deque[tuple[int, bytes]] = deque(maxlen=8)
    sent = dict.fromkeys((GID, OTHER), 0)
    obeyed = dict.fromkeys((GID, OTHER), 0)
    began = clock.now_ns
    while clock.now_ns < began + 2 * 10**9:
        for gid, due in ((GID, 20), (OTHER, rate)):
            while sent[gid] < (clock.now_ns - began) * due / 1e9:
                sent[gid] += 1
                ring.append((sent[gid], gid))
        while ring:
            sequence, gid = ring.popleft()
            obeyed[gid] += clock.deliver(inbox, sequence, gid)
        clock.wait(0.05)
    assert obeyed == {GID: sent[GID], OTHER: 0}
    assert inbox.master == GID
    assert inbox.refused > 0.9 * sent[OTHER]
    assert max(clock.slept, default=0.0) < 0.001


@pytest.mark.parametrize("gid", [GID, OTHER], ids=["master", "other"])
def test_in_a_crowd_silence_proves_nothing(inbox: Inbox, clock: Clock, gid: bytes) -> None:
    """Whether the master is silent, or all it says is lost among thousands of others."""
    inbox.ranks[OTHER] = 0
    clock.deliver(inbox, 1)
    for sequence in range(1, 6001):  # 0.6 s
        assert not clock.deliver(inbox, sequence, OTHER)
        clock.wait(0.1)
    assert not inbox.silent
    assert clock.slept, "the loop gets its time"
    clock.wait(HOLD_MS + 1)
    assert inbox.silent
    assert clock.deliver(inbox, 6001, gid)
    assert inbox.master == gid


def test_who_repeats_its_commands_as_a_planner_does_is_no_crowd(inbox: Inbox, clock: Clock) -> None:
    clock.deliver(inbox, 1)
    refused = 0
    while not clock.deliver(inbox, refused + 1, OTHER):
        refused += 1
        clock.wait(5)
    assert refused == HOLD_MS / 5 + 1
    assert not clock.slept


def test_who_is_refused_is_not_read(inbox: Inbox) -> None:
    deliver(inbox, 1)
    inbox.deliver("cmd_vel", b"\xff" * 52, ros.pack_attachment(1, 0, OTHER))
    inbox.deliver("cmd_pose", b"\xff" * 52, ros.pack_attachment(1, 0, bytes(15) + b"x"))
    assert (inbox.refused, inbox.malformed) == (1, 1), "a stranger may have a topic of its own"


def test_a_stranger_who_is_refused_makes_nobody_forgotten(inbox: Inbox, clock: Clock) -> None:
    for sequence in range(1, 40):
        assert clock.deliver(inbox, sequence)
        clock.wait(50)
    for number in range(200):
        assert not clock.deliver(inbox, 1, number.to_bytes(16, "big"))
    assert not clock.deliver(inbox, 5, age_ms=1700)
    assert (inbox.disordered, inbox.stale) == (1, 0)


def test_many_who_have_commanded_do_not_make_the_master_forgotten(inbox: Inbox, clock: Clock) -> None:
    inbox.ranks[GID] = 1
    assert clock.deliver(inbox, 7)
    for number in range(200):
        clock.wait(HOLD_MS + 1)
        assert clock.deliver(inbox, 1, number.to_bytes(16, "big"))
        assert clock.deliver(inbox, 8 + number)
    assert not clock.deliver(inbox, 100)
    assert inbox.disordered == 1


def test_overtaken_and_repeated_commands_are_dropped(inbox: Inbox) -> None:
    for sequence in (5, 4, 5):
        deliver(inbox, sequence)
    assert inbox.disordered == 2


def test_a_new_sender_starts_its_own_count(inbox: Inbox) -> None:
    deliver(inbox, 50)
    deliver(inbox, 1, gid=bytes(16))
    assert inbox.disordered == 0


def test_stale_commands_are_never_executed(inbox: Inbox) -> None:
    deliver(inbox, 1)
    assert inbox.take() is not None
    deliver(inbox, 2, age_ms=3000)
    assert inbox.take() is None
    assert inbox.stale == 1
    deliver(inbox, 3)
    assert inbox.take() is not None


@pytest.mark.parametrize("payload", [b"", b"\0\1\0\0", b"\xff" * 52, b"\0\1\0\0" + b"\xff" * 48])
def test_malformed_commands_are_counted(inbox: Inbox, payload: bytes) -> None:
    inbox.deliver("cmd_vel", payload, ros.pack_attachment(1, 0, GID))
    assert inbox.malformed == 1
    assert inbox.take() is None


def test_a_command_without_its_time_is_malformed(inbox: Inbox) -> None:
    inbox.deliver("cmd_vel", ros.encode_twist((0, 0, 0), (0, 0, 0)), b"")
    assert inbox.malformed == 1


def test_age_needs_no_common_clock() -> None:
    ages = AgeFilter()
    offset = -7 * 3600 * 10**9  # the master's clock is seven hours wrong
    assert ages.age_ns(offset, 5 * MS) == 0
    assert ages.age_ns(offset + 50 * MS, 57 * MS) == pytest.approx(2 * MS, abs=10_000)
    assert ages.age_ns(offset + 100 * MS, 103 * MS) == 0


def test_age_follows_drifting_clocks() -> None:
    ages = AgeFilter()
    hour = 3600 * 10**9
    age = 0
    for second in range(0, 3600, 10):
        sent = second * 10**9
        age = ages.age_ns(sent, sent + round(second * 10**9 * 40e-6))  # 40 ppm apart
    assert age < 1 * MS, f"after {hour} ns the drift of 144 ms does not count as age"


def commands(inbox: Inbox, clock: Clock, first: int, seconds: float, age_ms: float, each: int = 1) -> list[bool]:
    """Which of those that come twenty times a second are obeyed; `each`: so many numbers apart."""
    obeyed = []
    for sequence in range(first, first + round(20 * seconds) * each, each):
        clock.wait(50)
        obeyed.append(clock.deliver(inbox, sequence, age_ms=age_ms + sequence % 3 * 5))
    return obeyed


def test_a_clock_that_is_set_back_is_believed_after_some_seconds(inbox: Inbox, clock: Clock) -> None:
    assert all(commands(inbox, clock, 1, 5, 2))
    obeyed = commands(inbox, clock, 101, 10, 2002)
    assert obeyed.index(True) == pytest.approx(100, abs=3), "five seconds"
    assert all(obeyed[103:])
    assert inbox.stale == obeyed.index(True)
    assert inbox.fault == "cmd_vel: the clock of its sender was set back by 2.00 s"
    assert not clock.deliver(inbox, 1000, age_ms=2500), "age counts from there"
    assert inbox.fault.startswith("cmd_vel: 0.5")


def test_old_commands_do_not_pass_for_a_clock_that_was_set(inbox: Inbox, clock: Clock) -> None:
    commands(inbox, clock, 1, 5, 2)
    for sequence in range(101, 501):  # the network was away for 20 s, and all of that comes now
        clock.wait(1)
        age_ms = (500.0 - sequence) * 50
        assert not clock.deliver(inbox, sequence, age_ms=age_ms) or age_ms < 103
    for draining_s in (6.0, 60.0):  # a queue of 3 s that lasts
        for step in range(round(20 * draining_s)):
            clock.wait(50)
            age_ms = 3000 * (1 - step / 20 / draining_s)
            sequence = round(500 + 2000 * draining_s + step)
            assert not clock.deliver(inbox, sequence, age_ms=age_ms) or age_ms < 103
    assert not any(commands(inbox, clock, 200_000, 20, 3000, each=2)), "one that is full, and loses every other"


def test_a_clock_that_is_compared_needs_no_guess(inbox: Inbox, clock: Clock) -> None:
    exact = inbox.clocks[GID] = ClockOffset()
    now = to_wall_ns(clock.now_ns)
    exact.add(now, now, now, now)
    assert not any(commands(inbox, clock, 1, 10, 2000))
