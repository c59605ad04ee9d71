"""Commands: the newest counts, old and broken ones are dropped and counted."""

import select
import time
from collections.abc import Iterator

import pytest

from hil.autonomy.control import VelocityCommand
from hil.clock import now_ns, to_wall_ns
from hil.slave.inbox import AgeFilter, Inbox
from hil.transport import ros
from hil.transport.clock_offset import ClockOffset

GID, OTHER = bytes(range(16)), bytes(16)
MS = 1_000_000


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
