"""Checks that depend on the clock of a busy machine: time in which this process could run, and retries."""

import functools
import sys
import threading
import types
from collections.abc import Callable
from typing import TYPE_CHECKING, ParamSpec

if TYPE_CHECKING:
    from typing_extensions import Self

P = ParamSpec("P")


class RunClock:
    """A clock that stands still while this process does not get the processor. Use as a context.

    Its thread counts pauses of `TICK_S`. On an idle machine `seconds` is a little less than the time that passes, on a
    busy one far less. So a limit of such a time is not exceeded because other processes run.
    """

    TICK_S = 0.01

    def __init__(self) -> None:
        self._ticks = 0
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, name="run clock", daemon=True)

    def __enter__(self) -> "Self":
        self._thread.start()
        return self

    def __exit__(
        self, _: type[BaseException] | None, __: BaseException | None, ___: types.TracebackType | None
    ) -> None:
        self._end.set()
        self._thread.join()

    @property
    def seconds(self) -> float:
        """Time since the clock was started, s."""
        return self._ticks * self.TICK_S

    def _run(self) -> None:
        while not self._end.wait(self.TICK_S):
            self._ticks += 1


def retry_when_busy(judge: Callable[[], object], reason: str, attempts: int = 5) -> None:
    """Call `judge` until it raises no AssertionError, at most `attempts` times; the last error is raised.

    Only for what measures elapsed time or a share of the processor, where another process may interfere: a real
    fault fails in every attempt. Each failure is printed with the `reason`.
    """
    for attempt in range(1, attempts + 1):
        try:
            judge()
            return
        except AssertionError as error:
            if attempt == attempts:
                raise
            # Not to standard output, which the next attempt may read.
            print(f"attempt {attempt} of {attempts} ({reason}): {error}", file=sys.stderr)


def retried_when_busy(reason: str, attempts: int = 3) -> Callable[[Callable[P, object]], Callable[P, None]]:
    """Return a decorator that applies `retry_when_busy` to a whole test; its fixtures are made only once."""

    def decorate(test: Callable[P, object]) -> Callable[P, None]:
        @functools.wraps(test)
        def judged(*values: P.args, **fixtures: P.kwargs) -> None:
            retry_when_busy(lambda: test(*values, **fixtures), reason, attempts)

        return judged

    return decorate
