"""Time of a recording or simulation, which can be paused, stepped and sped up."""

from collections.abc import Callable

from hil.common.clock import NS_PER_S, now_ns

STEP_S = 0.05
NO_END = float("inf")


class PacedTime:
    """Seconds since the first instant, from 0 to `duration` (0: the end is not known). `clock` gives ns.

    `paused` and `speed`, a multiple of real time, are set by `change`.
    """

    def __init__(self, duration: float = 0.0, clock: Callable[[], int] = now_ns) -> None:
        self.duration = duration
        self.paused, self.speed = False, 1.0
        self._clock = clock
        self._base, self._since_ns = 0.0, clock()

    @property
    def time(self) -> float:
        """Seconds since the first instant."""
        passed = 0.0 if self.paused else (self._clock() - self._since_ns) / NS_PER_S * self.speed
        return min(self._base + passed, self.duration or NO_END)

    def change(self, time: float | None = None, paused: bool | None = None, speed: float | None = None) -> None:
        """Continue from `time` (s), paused or not, at `speed`; None: as before."""
        at = self.time if time is None else max(0.0, min(time, self.duration or NO_END))
        self._base, self._since_ns = at, self._clock()
        self.paused = self.paused if paused is None else paused
        self.speed = speed or self.speed

    def step(self) -> None:
        """Advance by STEP_S, and pause."""
        self.change(self.time + STEP_S, paused=True)
