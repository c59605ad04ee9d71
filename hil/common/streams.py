"""Standard streams that accept every text, a progress line, and a yes/no question."""

import os
import sys
import time
from codecs import register_error
from collections.abc import Callable
from contextlib import suppress
from io import TextIOWrapper
from typing import NoReturn, TextIO

from hil.common.errors import ConfigError

# Replacements on a terminal that can show only ASCII; "?" for all other characters.
PLAIN = {"°": "deg", "²": "2", "³": "3", "±": "+-", "·": "*", "µ": "u", "–": "-", "—": "-", "…": "...", "→": "->"}

TERMINAL_PERIOD_S = 0.2
LINE_PERIOD_S = 10.0

LOOK_FIRST = "look at it with --dry-run, do it with --yes"


def prepare() -> None:
    """Make the standard streams of this process usable. Raises ConfigError if standard output is closed.

    Characters that the terminal's encoding lacks are replaced. Closed standard descriptors are opened on /dev/null;
    otherwise the next file to be opened would get their number.
    """
    while (fd := os.open(os.devnull, os.O_RDWR)) <= 2:
        pass
    os.close(fd)
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115 - open until the process ends
    if sys.stdout is None:
        sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
        raise ConfigError("standard output is closed; send it to /dev/null if nobody is to read it")
    register_error("uuv_hil_plain", _plain)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="uuv_hil_plain")


def drop_output() -> None:
    """Discard pending output, because its reader has closed it or the disk is full."""
    null = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(null, sys.stdout.fileno())
    except (OSError, ValueError):  # not a real file, as in a test
        pass
    finally:
        os.close(null)


def leave(code: int) -> NoReturn:
    """Flush the output and end the process at once, whatever its other threads do."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):  # the stream is closed, here or by its reader
            stream.flush()
    os._exit(code)


def _plain(error: UnicodeError) -> tuple[str, int]:
    """Return the replacement of characters that cannot be encoded, and the next position (codecs.register_error)."""
    assert isinstance(error, UnicodeEncodeError)
    return "".join(PLAIN.get(letter, "?") for letter in error.object[error.start : error.end]), error.end


class ProgressLine:
    """Update one line on a terminal, some times a second; elsewhere print a line every ten seconds.

    It is written to standard error, because standard output is for results. Elsewhere the first line comes after ten
    seconds, so that short work prints none, or immediately if `at_once`. `clock` returns seconds.
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
        """Print the progress if the next update is due."""
        now = self._clock()
        if now < self._due_s:
            return
        self._due_s = now + (TERMINAL_PERIOD_S if self._terminal else LINE_PERIOD_S)
        self._is_open = self._terminal
        print(f"\r\x1b[K{text}" if self._terminal else text, end="" if self._terminal else "\n", file=self._stream)
        self._stream.flush()

    def clear(self) -> None:
        """Clear the line before other output."""
        if self._is_open:
            print("\r\x1b[K", end="", file=self._stream, flush=True)
        self._is_open = False


def agreed(question: str, otherwise: str) -> bool:
    """Return whether the answer is yes. Raises ConfigError, with the hint `otherwise`, without a terminal for input."""
    if not sys.stdin.isatty():
        raise ConfigError(f"nobody can be asked here: {otherwise}")
    return input(f"{question} [y/N] ").strip().lower() in ("y", "yes")
