"""The speed of a serial line whose other end is a pseudo terminal: who reads at another speed reads rubbish."""

from collections import deque
from collections.abc import Iterator
from math import ceil

from hil.links.contract import Wire
from hil.links.wires.terminal import PtyWire


class SpeedWire(Wire):
    """A pseudo terminal, which it owns, as the UART of a device at `baud` bit/s.

    What passes between two speeds arrives as a UART samples it; received bytes have the speed that the program has when
    they are read, so it waits for an answer before it changes it. A program that sets no speed has the first one. With
    `automatic` bytes the device takes the speed at which a program sends these, as those do that measure the first one.
    """

    def __init__(self, wire: PtyWire, baud: int, automatic: bytes = b"") -> None:
        self.name, self._wire, self._automatic = wire.name, wire, automatic
        self._baud, self._written = baud, 0
        self._changes: deque[tuple[int, int]] = deque()  # bytes that go out before a change, and the speed then
        wire.set_baud(baud)

    @property
    def baud(self) -> int:
        """Speed (bit/s) of what is written from now on."""
        return self._changes[-1][1] if self._changes else self._baud

    def set_baud(self, baud: int, after: int) -> None:
        """Change the speed when `after` bytes have been written since it was opened."""
        self._changes.append((after, baud))

    def fileno(self) -> int:
        """Return the descriptor to wait on."""
        return self._wire.fileno()

    def read(self) -> bytes:
        """Return what the device makes of the received bytes. Raises DeviceError if the device is lost."""
        data = self._wire.read()
        if not data:
            return data
        self._change()
        theirs = self._wire.baud
        if theirs != self._baud and self._automatic and data.startswith(self._automatic):
            self._baud = theirs
        return _sampled(data, theirs, self._baud)

    def write(self, data: bytes) -> int:
        """Write `data`; return the number of bytes accepted. Raises DeviceError if the device is lost."""
        self._change()
        self._written += len(data)
        arriving = _sampled(data, self._baud, self._wire.baud)
        return len(data) if self._wire.write(arriving) == len(arriving) else 0

    def close(self) -> None:
        """Close the device. May be called twice."""
        self._wire.close()

    def _change(self) -> None:
        while self._changes and self._written >= self._changes[0][0]:
            self._baud = self._changes.popleft()[1]


def _sampled(data: bytes, sent: int, read: int) -> bytes:
    """Return what a UART at `read` bit/s makes of bytes sent at `sent` bit/s, both with eight bits and no parity."""
    return data if sent == read or not read else bytes(_samples(data, sent / read))


def _samples(data: bytes, ratio: float) -> Iterator[int]:
    levels = [level for byte in data for level in (0, *[byte >> bit & 1 for bit in range(8)], 1)]
    levels += [1] * ceil(10 * ratio)  # the line is idle afterwards
    at = 0
    while 0 in levels[at:]:
        start = levels.index(0, at)
        middles = [int(start + (bit + 1.5) * ratio) for bit in range(9)]
        yield sum(levels[middle] << bit for bit, middle in enumerate(middles[:8]))
        at = levels.index(1, middles[-1])
