"""Links that are not read, or that have lost the other of two, by a clock of the test."""

import itertools

import pytest

from hil.common.clock import NS_PER_S
from hil.network.unread_links import LONGEST_CHECK_NS, UnreadLinks

LEASE_S = 0.8
CHECK_NS = NS_PER_S // 2


def test_a_link_is_unread_after_two_leases_without_a_read() -> None:
    links, alive, stuck = UnreadLinks(LEASE_S), (1, 2), (1, 4)
    for tick in range(20):
        found = links.find_unread(CHECK_NS, {alive: 40 * tick, stuck: 30})
        assert found == ({stuck} if tick / 2 >= 2 * LEASE_S else set())
    assert links.find_unread(CHECK_NS, {stuck: 31}) == set()


def test_a_pause_of_this_process_does_not_mark_a_link_as_unread() -> None:
    """A check after the pause counts as one second, however long it was, and by the next something was read."""
    links, sound = UnreadLinks(LEASE_S), (1, 2)
    assert LONGEST_CHECK_NS < 2 * LEASE_S * NS_PER_S
    for pause in range(100):
        assert links.find_unread(CHECK_NS, {sound: pause}) == set()
        assert links.find_unread(LONGEST_CHECK_NS, {sound: pause}) == set()


def test_a_link_without_waiting_bytes_counts_as_read() -> None:
    """The peer or the network is held up, and not the reader, where no bytes wait."""
    links, idle = UnreadLinks(LEASE_S), (1, 2)
    for _ in range(3):
        for _ in range(3):
            assert links.find_unread(CHECK_NS, {idle: 30}) == set()
        assert links.find_unread(CHECK_NS, {}) == set()


def test_one_missing_link_of_two_for_two_leases_is_half_a_session() -> None:
    """A session that only listens never had two links, so one is not half of it."""
    links = UnreadLinks(LEASE_S)
    assert links.find_halves(CHECK_NS, ["whole", "half", "whole", "half", "listener"]) == set()
    for tick in range(4):
        found = links.find_halves(CHECK_NS, ["whole", "half", "whole", "listener"])
        assert found == ({"half"} if tick / 2 >= 2 * LEASE_S else set())
    assert links.find_halves(CHECK_NS, ["half", "half", "whole"]) == set()
    assert links.find_halves(CHECK_NS, ["half", "whole", "whole"]) == set()


@pytest.mark.parametrize("is_seen_lost", [True, False], ids=["seen lost", "back by the next look"])
def test_a_master_with_one_link_has_half_a_session(is_seen_lost: bool) -> None:
    """The session is half from the beginning; each report waits twice as long, as a port may be out of reach."""
    links, reported = UnreadLinks(LEASE_S, has_pairs=True), []
    for tick in range(1200):
        if links.find_halves(CHECK_NS, ["half"]) == {"half"}:
            reported.append(tick / 2)
            if is_seen_lost:
                links.find_halves(CHECK_NS, [])
    waits = [later - sooner for sooner, later in itertools.pairwise(reported)]
    assert reported[0] <= 2 * LEASE_S + 0.5
    assert waits[1] > 1.5 * waits[0]
    assert 55.0 < waits[-1] < 62.0
