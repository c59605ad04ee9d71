"""Time that is paused, stepped and sped up, by a clock that the test advances."""

from hil.common.clock import NS_PER_S
from hil.view.sources.paced_time import STEP_S, PacedTime


class Clock:
    def __init__(self) -> None:
        self.ns = 5 * NS_PER_S

    def __call__(self) -> int:
        return self.ns

    def advance(self, seconds: float) -> None:
        self.ns += round(seconds * NS_PER_S)


def test_time_runs_pauses_steps_seeks_and_ends() -> None:
    clock = Clock()
    time = PacedTime(10.0, clock)
    clock.advance(2.0)
    assert time.time == 2.0
    time.change(speed=4.0)
    clock.advance(0.5)
    assert time.time == 4.0
    time.change(paused=True)
    clock.advance(3.0)
    assert time.time == 4.0
    time.step()
    assert time.time == 4.0 + STEP_S
    assert time.paused
    time.change(paused=False)
    clock.advance(100.0)
    assert time.time == 10.0, "the end"
    time.change(1.5)
    assert time.time == 1.5
    time.change(-3.0)
    assert time.time == 0.0


def test_time_without_an_end_runs_on() -> None:
    clock = Clock()
    time = PacedTime(0.0, clock)
    clock.advance(1e6)
    assert time.time == 1e6
