"""Time of a recording or simulation, which can be paused, stepped and sped up."""

from collections.abc import Callable

from hil.common.clock import NS_PER_S, now_ns

STEP_S = 0.05
NO_END = float("inf")


class PacedTime:
    """Seconds since the first instant, from 0 to `duration` (0: the end is not known). `clock` gives ns."""

    def __init__(self, duration: float = 0.0, clock: Callable[[], int] = now_ns) -> None:
        self.duration = duration
        self._clock = clock
        self._speed = 1.0
        self._paused = False
        self._base, self._since_ns = 0.0, clock()

    @property
    def time(self) -> float:
        """Seconds since the first instant."""
        passed = 0.0 if self._paused else (self._clock() - self._since_ns) / NS_PER_S * self._speed
        return min(self._base + passed, self.duration or NO_END)

    @property
    def paused(self) -> bool:
        """True while the time is paused."""
        return self._paused

    @paused.setter
    def paused(self, paused: bool) -> None:
        self.seek(self.time)
        self._paused = paused

    @property
    def speed(self) -> float:
        """Speed as a multiple of real time."""
        return self._speed

    @speed.setter
    def speed(self, speed: float) -> None:
        self.seek(self.time)
        self._speed = speed

    def step(self) -> None:
        """Advance by STEP_S, and pause."""
        self.seek(self.time + STEP_S)
        self._paused = True

    def seek(self, time: float) -> None:
        """Continue from `time` (s)."""
        self._base, self._since_ns = max(0.0, min(time, self.duration or NO_END)), self._clock()
