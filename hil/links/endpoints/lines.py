"""Serial lines as endpoints, with one partner: a serial device, and a pseudo terminal with a lasting name."""

from hil.common.errors import DeviceError
from hil.links.contract import Wire
from hil.links.endpoints.sockets import Address, Link, Received

TICKS_PER_S = 50
WAITING = 4096  # bytes that a paced line holds; a message beyond is lost as a whole


class LineLink(Link):
    """A line on a wire, which it owns."""

    def __init__(self, name: str, wire: Wire, baud: int) -> None:
        self.name, self._wire = name, wire
        self.burst = max(300, baud // 10 // TICKS_PER_S // 2)  # half of what it carries
        self.lost_messages = self._accepted = 0
        self._next_baud = 0

    def descriptors(self) -> list[int]:
        """Return the device's."""
        return [self._wire.fileno()]

    def receive(self, now: int) -> Received:
        """Return what has come."""
        try:
            data = self._wire.read()
        except DeviceError:
            self.is_lost, data = True, b""
        return [(self._wire.name, data)] if data else []

    def send(self, address: Address, data: bytes) -> None:
        """Write a packet; what the line does not take is lost."""
        try:
            if self._wire.unsent() + len(data) > WAITING:
                self.lost_messages += 1
            else:
                self._accepted += self._wire.write(data)
        except DeviceError:
            self.is_lost = True

    def partners(self) -> list[Address]:
        """Return the device."""
        return [self._wire.name]

    def is_local(self, address: Address) -> bool:
        """Return true: it is a wire of this machine."""
        return True

    def set_baud(self, baud: int) -> None:
        """Change the speed once all that was sent has gone out."""
        self._next_baud = baud
        self.tick(0)

    def tick(self, now: int) -> None:
        """Change the speed if it is time."""
        if self._next_baud and not self._wire.unsent():
            baud, self._next_baud = self._next_baud, 0
            try:
                self._use_baud(baud)
            except DeviceError:
                self.is_lost = True

    def _use_baud(self, baud: int) -> None:
        """Change the speed now. Raises DeviceError."""

    def close(self) -> None:
        """Close the device."""
        self._wire.close()


class SerialLink(LineLink):
    """A serial device. Raises DeviceError."""

    def __init__(self, device: str, baud: int) -> None:
        from hil.links.wires.terminal import UartWire  # needs a system with terminals; without a serial port none does

        self._uart = UartWire(device, baud)
        super().__init__(f"serial:{device}:{baud}", self._uart, baud)

    def _use_baud(self, baud: int) -> None:
        self._uart.set_baud(baud)


class PtyLink(LineLink):
    """A pseudo terminal that other programs open by the name `path`, as fast as a line of that speed.

    Raises DeviceError.
    """

    def __init__(self, path: str, baud: int) -> None:
        from hil.links.wires.terminal import PtyWire

        self._pace(PtyWire(path), path, baud)

    def _pace(self, wire: Wire, path: str, baud: int) -> None:
        from hil.links.wires.faults import Faults, FaultyWire

        self._line = FaultyWire(wire, Faults(baud=baud))
        super().__init__(f"pty:{path}:{baud}", self._line, baud)


class UartPtyLink(PtyLink):
    """A pseudo terminal at whose other end a program at another speed reads rubbish; `automatic` as for `SpeedWire`.

    Raises DeviceError.
    """

    def __init__(self, path: str, baud: int, automatic: bytes) -> None:
        from hil.links.wires.line_speed import SpeedWire
        from hil.links.wires.terminal import PtyWire

        self._uart = SpeedWire(PtyWire(path), baud, automatic)
        self._pace(self._uart, path, baud)

    def set_baud(self, baud: int) -> None:
        """Change the speed of what is sent from now on."""
        self._uart.set_baud(baud, self._accepted)
        self._line.faults = self._line.faults._replace(baud=baud)

    def receive(self, now: int) -> Received:
        """Return what has come; the program at the other end may have chosen the speed."""
        received = super().receive(now)
        if received and self._uart.baud != self._line.faults.baud:
            self._line.faults = self._line.faults._replace(baud=self._uart.baud)
        return received
