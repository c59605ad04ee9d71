"""Standard streams that accept every text, a line of progress, and a question."""

import os
import sys
import time
from codecs import register_error
from collections.abc import Callable
from contextlib import suppress
from io import TextIOWrapper
from typing import NoReturn, TextIO

from hil.common.errors import ConfigError

# What a terminal of ASCII alone shows instead; "?" for the rest.
PLAIN = {"°": "deg", "²": "2", "³": "3", "±": "+-", "·": "*", "µ": "u", "–": "-", "—": "-", "…": "...", "→": "->"}

TERMINAL_PERIOD_S = 0.2
LINE_PERIOD_S = 10.0

LOOK_FIRST = "look at it with --dry-run, do it with --yes"


def prepare() -> None:
    """Make the standard streams of this process usable. Raises ConfigError if standard output is closed.

    What a terminal's character set lacks is shown in other letters. The descriptor of a stream that is closed would go
    to the first file that is opened.
    """
    while (fd := os.open(os.devnull, os.O_RDWR)) <= 2:
        pass
    os.close(fd)
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115 - open as long as the process
    if sys.stdout is None:
        sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
        raise ConfigError("standard output is closed; send it to /dev/null if nobody is to read it")
    register_error("uuv_hil_plain", _plain)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="uuv_hil_plain")


def drop_output() -> None:
    """Discard what is still to be printed: nobody reads it, or there is no room."""
    null = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(null, sys.stdout.fileno())
    except (OSError, ValueError):  # no file, as under a test
        pass
    finally:
        os.close(null)


def leave(code: int) -> NoReturn:
    """End the process now, whatever its other threads do, once all that was printed is out."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):  # nobody reads it, or it is closed
            stream.flush()
    os._exit(code)


def _plain(error: UnicodeError) -> tuple[str, int]:
    """Return other letters for those that cannot be encoded, and where to go on (see codecs.register_error)."""
    assert isinstance(error, UnicodeEncodeError)
    return "".join(PLAIN.get(letter, "?") for letter in error.object[error.start : error.end]), error.end


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
        """Print the progress, if it is time to print it again."""
        now = self._clock()
        if now < self._due_s:
            return
        self._due_s = now + (TERMINAL_PERIOD_S if self._terminal else LINE_PERIOD_S)
        self._is_open = self._terminal
        print(f"\r\x1b[K{text}" if self._terminal else text, end="" if self._terminal else "\n", file=self._stream)
        self._stream.flush()

    def clear(self) -> None:
        """Clear the line, before something else is printed."""
        if self._is_open:
            print("\r\x1b[K", end="", file=self._stream, flush=True)
        self._is_open = False


def agreed(question: str, otherwise: str) -> bool:
    """Return True if the answer is yes. Raises ConfigError, with what to do `otherwise`, where nobody can be asked."""
    if not sys.stdin.isatty():
        raise ConfigError(f"nobody can be asked here: {otherwise}")
    return input(f"{question} [y/N] ").strip().lower() in ("y", "yes")
