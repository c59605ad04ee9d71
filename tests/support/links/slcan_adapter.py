"""CAN adapters with the Lawicel protocol, each on a pty, all on one bus, for tests without hardware."""

import os
import select
import threading

from hil.links.contract import Wire
from hil.links.wires.terminal import PtyWire

ACKNOWLEDGED = {b"t": b"z\r", b"T": b"Z\r", b"r": b"z\r", b"R": b"Z\r"}


class SlcanBus:
    """`paths` are the adapters' serial ports. Frames sent by one are passed to the ports of all others that are open.

    `output` has all received lines, without their end, by adapter.
    """

    def __init__(self, adapters: int = 2) -> None:
        self._ports = [PtyWire() for _ in range(adapters)]
        self.paths = [port.path for port in self._ports]
        self.output: list[list[bytes]] = [[] for _ in self._ports]
        self._rests = [b""] * adapters
        self._open = [False] * adapters
        self._users = adapters
        self._stop_fd = os.eventfd(0)
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def leave(self) -> None:
        """Release the adapter; the last user closes it. More calls than users are harmless."""
        self._users -= 1
        if self._users == 0:
            self.close()

    def close(self) -> None:
        os.eventfd_write(self._stop_fd, 1)
        self._thread.join()
        os.close(self._stop_fd)
        for port in self._ports:
            port.close()

    def _run(self) -> None:
        while True:
            ready = select.select([self._stop_fd, *[port.fileno() for port in self._ports]], [], [])[0]
            if self._stop_fd in ready:
                return
            for number, port in enumerate(self._ports):
                if port.fileno() in ready:
                    self._read_line(number, port)

    def _read_line(self, number: int, port: Wire) -> None:
        *lines, self._rests[number] = (self._rests[number] + port.read()).split(b"\r")
        for line in filter(None, lines):
            self.output[number].append(line)
            kind = line[:1]
            if kind in (b"O", b"C"):
                self._open[number] = kind == b"O"
            if kind in ACKNOWLEDGED and not self._open[number]:
                port.write(b"\a")
                continue
            port.write(ACKNOWLEDGED.get(kind, b"\r"))
            if kind in ACKNOWLEDGED:
                self._pass_on(number, line + b"\r")

    def _pass_on(self, sender: int, line: bytes) -> None:
        for number, port in enumerate(self._ports):
            if number != sender and self._open[number]:
                port.write(line)
