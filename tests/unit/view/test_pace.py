"""The view draws soon after a sample at any phase, at a limited rate with many vehicles, and also without samples."""

from itertools import pairwise

import pytest

from hil.common.clock import NS_PER_MS
from hil.view.pace import GATHER_NS, MAX_NS, MIN_NS, Pace

PERIOD = 50 * NS_PER_MS


def drawing_times(samples: list[int], end: int) -> list[int]:
    """Return the times (ns) of drawing when samples come at these times."""
    pace, now, drawn_times, waiting = Pace(0), 0, list[int](), sorted(samples)
    while now < end:
        if pace.draws(now):
            drawn_times.append(now)
        now = min([pace.due_ns, *waiting[:1]])
        while waiting and waiting[0] <= now:
            pace.on_sample(waiting.pop(0))
    return drawn_times


@pytest.mark.parametrize("phase_ms", range(0, 50, 7))
def test_a_sample_is_drawn_soon_at_any_phase(phase_ms: int) -> None:
    samples = [phase_ms * NS_PER_MS + number * PERIOD for number in range(40)]
    times = drawing_times(samples, samples[-1] + PERIOD)
    for sample in samples[8:]:  # once the beat is found
        assert min(time - sample for time in times if time >= sample) == GATHER_NS
    assert len(times) <= len(samples) + 3


def test_simultaneous_samples_are_drawn_together() -> None:
    samples = [number * PERIOD + part * NS_PER_MS for number in range(1, 20) for part in (0, 1, 2)]
    assert len(drawing_times(samples, 20 * PERIOD)) <= 21


def test_the_drawing_rate_is_limited_with_many_vehicles() -> None:
    drawn = drawing_times([number * NS_PER_MS for number in range(2000)], 2000 * NS_PER_MS)
    assert min(after - before for before, after in pairwise(drawn)) >= MIN_NS


def test_drawing_continues_without_samples() -> None:
    drawn = drawing_times([], 10 * MAX_NS)
    assert drawn == [number * MAX_NS for number in range(10)]
