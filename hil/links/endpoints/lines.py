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
        self.lost_messages = 0

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
                self._wire.write(data)
        except DeviceError:
            self.is_lost = True

    def partners(self) -> list[Address]:
        """Return the device."""
        return [self._wire.name]

    def is_local(self, address: Address) -> bool:
        """Return true: it is a wire of this machine."""
        return True

    def close(self) -> None:
        """Close the device."""
        self._wire.close()


class SerialLink(LineLink):
    """A serial device. Raises DeviceError."""

    def __init__(self, device: str, baud: int) -> None:
        from hil.links.wires.terminal import UartWire  # needs a system with terminals; without a serial port none does

        super().__init__(f"serial:{device}:{baud}", UartWire(device, baud), baud)


class PtyLink(LineLink):
    """A pseudo terminal that other programs open by the name `path`, as fast as a line of that speed.

    Raises DeviceError.
    """

    def __init__(self, path: str, baud: int) -> None:
        from hil.links.wires.faults import Faults, FaultyWire
        from hil.links.wires.terminal import PtyWire

        super().__init__(f"pty:{path}:{baud}", FaultyWire(PtyWire(path), Faults(baud=baud)), baud)
