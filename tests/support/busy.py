"""Retries of checks that depend on the clock of a busy machine."""

import functools
import sys
from collections.abc import Callable
from typing import ParamSpec

P = ParamSpec("P")


def retry_when_busy(judge: Callable[[], object], reason: str, attempts: int = 5) -> None:
    """Call `judge` until it raises no AssertionError, at most `attempts` times; the last one is the test's.

    Only for what measures elapsed time or a share of the processor, where another process may have come between: what
    is broken is broken in every attempt. Each failed one is printed with the `reason`.
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
    """`retry_when_busy` for a whole test, which restarts what it needs: its fixtures are those of the first time."""

    def decorate(test: Callable[P, object]) -> Callable[P, None]:
        @functools.wraps(test)
        def judged(*values: P.args, **fixtures: P.kwargs) -> None:
            retry_when_busy(lambda: test(*values, **fixtures), reason, attempts)

        return judged

    return decorate
