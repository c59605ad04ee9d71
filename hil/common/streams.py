"""Prepare standard streams that accept every text, and handle Ctrl-C before there is anything to stop."""

import os
import signal
import sys
from codecs import register_error
from io import TextIOWrapper
from types import FrameType
from typing import NoReturn

from hil.common.errors import STOPPED, ConfigError

# What a terminal that knows ASCII alone shows instead; "?" for the rest.
PLAIN = {"°": "deg", "²": "2", "³": "3", "±": "+-", "·": "*", "µ": "u", "–": "-", "—": "-", "…": "...", "→": "->"}


def leave_on_ctrl_c() -> None:
    """End the process at Ctrl-C, at once and without a word: so early there is nothing to bring to an end."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # it may be ignored, as by nohup
        signal.signal(signal.SIGINT, _leave)


def raise_on_ctrl_c() -> None:
    """End what `leave_on_ctrl_c` began: Ctrl-C raises KeyboardInterrupt again."""
    if signal.getsignal(signal.SIGINT) is _leave:
        signal.signal(signal.SIGINT, signal.default_int_handler)


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
    """Let what is still to be printed go nowhere: nobody reads it, or there is no room."""
    null = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(null, sys.stdout.fileno())
    except (OSError, ValueError):  # no file, as under a test
        pass
    finally:
        os.close(null)


def _leave(_number: int, _frame: FrameType | None) -> NoReturn:
    os._exit(STOPPED)


def _plain(error: UnicodeError) -> tuple[str, int]:
    """Return other letters for those that cannot be encoded, and where to go on (see codecs.register_error)."""
    assert isinstance(error, UnicodeEncodeError)
    return "".join(PLAIN.get(letter, "?") for letter in error.object[error.start : error.end]), error.end
