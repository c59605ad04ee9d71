"""Show the progress of long work in one line on standard error."""

import sys
import time
from collections.abc import Callable
from typing import TextIO

TERMINAL_PERIOD_S = 0.2
LINE_PERIOD_S = 10.0


class ProgressLine:
    """Renews one line on a terminal, some times a second; elsewhere prints a line every ten seconds.

    Standard output is left to results. The first line elsewhere comes after ten seconds, as short work is done before,
    or `at_once`. `clock` gives seconds.
    """

    def __init__(
        self, stream: TextIO | None = None, clock: Callable[[], float] = time.monotonic, at_once: bool = False
    ) -> None:
        self._stream = stream or sys.stderr
        self._clock = clock
        self._terminal = self._stream.isatty()
        self._due_s = clock() + (0.0 if self._terminal or at_once else LINE_PERIOD_S)
        self._is_open = False

    def show(self, text: str) -> None:
        """Say how far it is, if it is time to say so again."""
        now = self._clock()
        if now < self._due_s:
            return
        self._due_s = now + (TERMINAL_PERIOD_S if self._terminal else LINE_PERIOD_S)
        self._is_open = self._terminal
        print(f"\r\x1b[K{text}" if self._terminal else text, end="" if self._terminal else "\n", file=self._stream)
        self._stream.flush()

    def clear(self) -> None:
        """Take the line away, before something else is printed."""
        if self._is_open:
            print("\r\x1b[K", end="", file=self._stream, flush=True)
        self._is_open = False
