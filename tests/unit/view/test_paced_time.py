"""Time that is paused, stepped and sped up, by a clock that the test advances."""

from hil.common.clock import NS_PER_S
from hil.view.sources.paced_time import STEP_S, PacedTime


def test_time_runs_pauses_steps_seeks_and_ends() -> None:
    now = [5 * NS_PER_S]
    time, endless = (PacedTime(duration, lambda: now[0]) for duration in (10.0, 0.0))

    def after(seconds: float) -> float:
        now[0] += round(seconds * NS_PER_S)
        return time.time

    assert after(2.0) == 2.0
    time.change(speed=4.0)
    assert after(0.5) == 4.0
    time.change(paused=True)
    assert after(3.0) == 4.0
    time.step()
    assert time.time == 4.0 + STEP_S
    assert time.paused
    time.change(paused=False)
    assert after(100.0) == 10.0, "the end"
    assert endless.time == 105.5
    time.change(1.5)
    assert time.time == 1.5
    time.change(-3.0)
    assert time.time == 0.0
