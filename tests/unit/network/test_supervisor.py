"""Detection of stalls, of unread links, and of sessions that lost the other of two, by a clock of the test."""

import itertools

import pytest

from hil.common.clock import NS_PER_MS, NS_PER_S
from hil.network.supervisor import FIRST_GAP_NS, GAPS, LONGEST_LINKS_NS, Received, Watched
from hil.network.workarounds.half_session import HalfSessions
from hil.network.workarounds.unread_link import UnreadLinks

LEASE_S = 0.8
CHECK_MS = 200
CHECK_NS = NS_PER_S // 2


class Bed:
    """A detector that is checked five times a second by a clock of its own."""

    def __init__(self) -> None:
        self.is_unanswered = False
        self.detector = Watched("uuv1", LEASE_S, lambda: Received(self.replies, self.samples, self.is_unanswered))
        self.now_ms = 1000
        self.replies = self.samples = 0

    def run(self, seconds: float, samples: int = 0, replies: int = 1, is_unanswered: bool = False) -> list[float]:
        """Add so many of each before each check; return when (s from now on) the detector reports a stall."""
        start, reported = self.now_ms, []
        while self.now_ms < start + 1000 * seconds:
            self.now_ms += CHECK_MS
            self.replies += replies
            self.samples += samples
            self.is_unanswered = is_unanswered
            if self.detector.is_stalled(self.now_ms * NS_PER_MS):
                reported.append((self.now_ms - start) / 1000)
        return reported


def test_replies_without_samples_for_two_leases_are_a_stall() -> None:
    bed = Bed()
    assert bed.run(60.0, samples=4) == []
    first, *_ = bed.run(3.0)
    assert 2 * LEASE_S <= first <= 2 * LEASE_S + 0.5
    assert bed.detector.attempts == 1
    assert 2 * LEASE_S <= bed.detector.lasted_s <= first


def test_the_wait_grows_with_each_attempt_until_a_sample_arrives() -> None:
    bed = Bed()
    bed.run(60.0, samples=4)
    reported = bed.run(600.0)
    waits = [later - sooner for sooner, later in zip([0.0, *reported], reported, strict=False)]
    assert waits[1] > 1.8 * waits[0]
    assert waits[-1] > 55.0
    assert len(reported) < 20
    bed.run(60.0, samples=4)
    assert bed.detector.attempts == 0
    assert bed.run(3.0)[0] < 2 * LEASE_S + 0.5


def test_a_vehicle_without_any_messages_is_not_a_stall() -> None:
    bed = Bed()
    bed.run(10.0, samples=4)
    assert bed.run(600.0, replies=0) == []


def test_a_link_without_replies_is_a_stall() -> None:
    bed = Bed()
    bed.run(10.0, samples=4)
    first, second, *_ = bed.run(60.0, replies=0, is_unanswered=True)
    least_s = 2 * LEASE_S + GAPS * FIRST_GAP_NS / NS_PER_S
    assert least_s <= first <= least_s + 0.5, "a router needs some time until it has found all vehicles again"
    assert second - first > 1.8 * first


def test_one_sample_a_second_prevents_a_stall() -> None:
    bed = Bed()
    for _ in range(100):
        assert bed.run(0.8) == bed.run(0.2, samples=1) == []
    assert bed.run(2 * LEASE_S + 1.0) == [], "rare samples are waited for longer"
    assert bed.run(3.0)


def test_a_pause_of_this_process_is_not_reported_as_a_stall() -> None:
    bed = Bed()
    bed.run(10.0, samples=4)
    bed.now_ms += 3_600_000
    assert bed.run(1.0) == []


def test_a_link_is_unread_after_two_leases_without_a_read() -> None:
    links, alive, stuck = UnreadLinks(LEASE_S), (1, 2), (1, 4)
    for tick in range(20):
        found = links.find(CHECK_NS, {alive: 40 * tick, stuck: 30})
        assert found == ({stuck} if tick / 2 >= 2 * LEASE_S else set())
    assert links.find(CHECK_NS, {stuck: 31}) == set()


def test_a_pause_of_this_process_does_not_mark_a_link_as_unread() -> None:
    """A check after the pause counts as one second, however long it was, and by the next something was read."""
    links, sound = UnreadLinks(LEASE_S), (1, 2)
    assert LONGEST_LINKS_NS < 2 * LEASE_S * NS_PER_S
    for pause in range(100):
        assert links.find(CHECK_NS, {sound: pause}) == set()
        assert links.find(LONGEST_LINKS_NS, {sound: pause}) == set()


def test_a_link_without_waiting_bytes_counts_as_read() -> None:
    """The peer or the network is held up, and not the reader, where no bytes wait."""
    links, idle = UnreadLinks(LEASE_S), (1, 2)
    for _ in range(3):
        for _ in range(3):
            assert links.find(CHECK_NS, {idle: 30}) == set()
        assert links.find(CHECK_NS, {}) == set()


def test_one_missing_link_of_two_for_two_leases_is_half_a_session() -> None:
    """A session that only listens never had two links, so one is not half of it."""
    links = HalfSessions(LEASE_S)
    assert links.find(CHECK_NS, ["whole", "half", "whole", "half", "listener"]) == set()
    for tick in range(4):
        found = links.find(CHECK_NS, ["whole", "half", "whole", "listener"])
        assert found == ({"half"} if tick / 2 >= 2 * LEASE_S else set())
    assert links.find(CHECK_NS, ["half", "half", "whole"]) == set()
    assert links.find(CHECK_NS, ["half", "whole", "whole"]) == set()


@pytest.mark.parametrize("is_seen_lost", [True, False], ids=["seen lost", "back by the next look"])
def test_a_master_with_one_link_has_half_a_session(is_seen_lost: bool) -> None:
    """The session is half from the beginning; each report waits twice as long, as a port may be out of reach."""
    links, reported = HalfSessions(LEASE_S, has_pairs=True), []
    for tick in range(1200):
        if links.find(CHECK_NS, ["half"]) == {"half"}:
            reported.append(tick / 2)
            if is_seen_lost:
                links.find(CHECK_NS, [])
    waits = [later - sooner for sooner, later in itertools.pairwise(reported)]
    assert reported[0] <= 2 * LEASE_S + 0.5
    assert waits[1] > 1.5 * waits[0]
    assert 55.0 < waits[-1] < 62.0
