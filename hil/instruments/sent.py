"""A file with a line for each measurement that was written to a wire: `uuv-hil instruments check` reads it."""

from collections.abc import Iterator
from typing import NamedTuple, TextIO


class Measurement(NamedTuple):
    """A line: sensor, number of the wire, bytes of the message, of all to its client, when measured (monotonic ns)."""

    name: str
    wire: int
    size: int
    total: int
    measured_ns: int


def write_sent(file: TextIO, measurement: Measurement) -> None:
    """Add a line to a file, in which several processes may write."""
    file.write(" ".join(map(str, measurement)) + "\n")


def read_sent(path: str) -> Iterator[Measurement]:
    """Yield the lines of a file, but not a last one that is incomplete."""
    with open(path, encoding="utf-8") as file:
        for line in file:
            words = line.split()
            if len(words) == 5 and line.endswith("\n"):
                yield Measurement(words[0], *map(int, words[1:]))
