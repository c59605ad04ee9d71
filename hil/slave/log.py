"""Log lines for a person without blocking the loop."""

import sys
import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress

from hil.common.clock import NS_PER_S, now_ns
from hil.common.text import clean

LONGEST = 1000  # characters of a line
MAX_LINES = 1000  # in each WINDOW_NS; further lines are only counted
WINDOW_NS = 10 * NS_PER_S


class Log:
    """Log lines on standard error. `write_line` only stores a line; `flush` writes it.

    A write may block (a slow terminal, a full disk); `write_line` never does. `wakeup` is set when a line is stored.
    What others on the network can cause is bounded: characters that do not print are replaced, long lines are cut, and
    lines beyond 1000 in 10 s are only counted. A line that is repeated is counted, too, and shown again every 10 s.
    `publish`, if it is set, is called with each line that is written, without its time.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._start_ns = now_ns()
        self._lines: deque[tuple[int, str]] = deque(maxlen=1000)
        self._window_ns, self._in_window, self._left_out = self._start_ns, 0, 0
        self._last, self._repeated = "", 0
        self._noting = threading.Lock()  # several threads write lines
        self.wakeup = threading.Event()
        self.publish: Callable[[str], None] | None = None

    def write_line(self, text: str) -> None:
        """Store a line with its time since the start."""
        now = now_ns()
        with self._noting:
            if now - self._window_ns > WINDOW_NS:
                self._add_omitted(now)
                self._window_ns, self._in_window = now, 0
            if text == self._last:
                self._repeated += 1
                return
            self._add_repeated(now)
            self._last = text
            self._in_window += 1
            if self._in_window > MAX_LINES:
                self._left_out += 1
                return
            self._add_line(text, now)
        self.wakeup.set()

    def _add_line(self, text: str, now: int) -> None:
        self._lines.append((now, clean(text, LONGEST)))

    def _add_repeated(self, now: int) -> None:
        if self._repeated:
            self._add_line(f"{self._repeated} times more: {self._last}", now)
            self._repeated = 0

    def _add_omitted(self, now: int) -> None:
        self._add_repeated(now)
        if self._left_out:
            self._add_line(f"{self._left_out} lines left out: more than {MAX_LINES} in {WINDOW_NS // NS_PER_S} s", now)
            self._left_out = 0

    def flush(self) -> None:
        """Write the stored lines; stop if the output is closed."""
        if self._left_out or self._repeated:
            with self._noting:
                if now_ns() - self._window_ns > WINDOW_NS:
                    self._add_omitted(now_ns())
                    self._window_ns, self._in_window = now_ns(), 0
        if self._lines:
            with suppress(OSError):  # the terminal is closed
                while self._lines:
                    now, text = self._lines.popleft()
                    if self.publish:
                        self.publish(text)
                    sys.stderr.write(f"[{(now - self._start_ns) / NS_PER_S:9.3f}] {self._name}: {text}\n")
                sys.stderr.flush()
