"""Detection of a stall, replies without samples, by a clock of the test."""

from hil.common.clock import NS_PER_MS, NS_PER_S
from hil.network.stall import FIRST_GAP_NS, GAPS, StallDetector

LEASE_S = 0.8
CHECK_MS = 200


class Bed:
    """A detector that is checked five times a second by a clock of its own."""

    def __init__(self) -> None:
        self.detector = StallDetector(LEASE_S)
        self.now_ms = 1000
        self.replies = self.samples = 0

    def run(self, seconds: float, samples: int = 0, replies: int = 1, is_unanswered: bool = False) -> list[float]:
        """Add so many of each before each check; return when (s from now on) the detector reports a stall."""
        start, reported = self.now_ms, []
        while self.now_ms < start + 1000 * seconds:
            self.now_ms += CHECK_MS
            self.replies += replies
            self.samples += samples
            if self.detector.is_stalled(self.now_ms * NS_PER_MS, self.replies, self.samples, is_unanswered):
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
