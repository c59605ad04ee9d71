"""Retries of checks that depend on the clock of a busy machine."""

import functools
import sys
from collections.abc import Callable
from typing import ParamSpec

P = ParamSpec("P")


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
