"""A file with a line for each measurement that was written to a wire: `uuv-hil instruments check` reads it.

A line is the sensor's name, the number of the wire, the bytes of the message and all bytes sent to this client so far,
and the instant of the measurement (monotonic ns).
"""

from collections.abc import Iterator
from typing import NamedTuple, TextIO

from hil.instruments.contract import Client


class Measurement(NamedTuple):
    """One message: its size, how many bytes have come with it, and when it was measured (monotonic ns)."""

    name: str
    wire: int
    size: int
    total: int
    measured_ns: int


class SentFile:
    """Adds to the file at `path`, in which several processes may write. Use as a context manager. Raises OSError."""

    def __init__(self, path: str) -> None:
        self._file: TextIO = open(path, "a", encoding="utf-8", buffering=1)  # noqa: SIM115 - closed by the context

    def __enter__(self) -> "SentFile":
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def add(self, name: str, client: Client, size: int, total: int, measured_ns: int) -> None:
        """Add a line."""
        self._file.write(f"{name} {client.wire} {size} {total} {measured_ns}\n")


def read_sent(path: str) -> Iterator[Measurement]:
    """Yield the lines of a file, but not a last one that is incomplete."""
    with open(path, encoding="utf-8") as file:
        for line in file:
            words = line.split()
            if len(words) == 5 and line.endswith("\n"):
                yield Measurement(words[0], *map(int, words[1:]))
