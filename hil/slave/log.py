"""Lines for a person, without the loop ever waiting for one."""

import sys
import threading
from collections import deque
from contextlib import suppress

from hil.clock import NS_PER_S, now_ns


class Log:
    """Lines for a person, on standard error. `say` only notes the line; `flush` writes it.

    Writing may block (a slow terminal, a full disk); noting never does. `news` is set when there is something to write.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._start_ns = now_ns()
        self._lines: deque[str] = deque(maxlen=1000)
        self.news = threading.Event()

    def say(self, text: str) -> None:
        """Note a line with its time since the start."""
        self._lines.append(f"[{(now_ns() - self._start_ns) / NS_PER_S:9.3f}] {self._name}: {text}\n")
        self.news.set()

    def flush(self) -> None:
        """Write what was noted, as long as there is somebody to read it."""
        if self._lines:
            with suppress(OSError):  # the terminal has gone
                while self._lines:
                    sys.stderr.write(self._lines.popleft())
                sys.stderr.flush()
