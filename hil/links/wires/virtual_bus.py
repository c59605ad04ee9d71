"""A CAN bus between the ends in this process, without any package; see `hil.links.wires.can_bus`."""

import socket

from hil.links.wires.can_frame import RECORD_SIZE
from hil.links.wires.terminal import READ_SIZE, DescriptorWire

_buses: dict[str, list["VirtualCanWire"]] = {}  # by name: the open ends


class VirtualCanWire(DescriptorWire):
    """One end of the virtual bus `channel`.

    Each end has a socket, into which the others write. One that does not read refuses further frames once it is full.
    """

    record_size = RECORD_SIZE

    def __init__(self, channel: str) -> None:
        exit_, self._entry = socket.socketpair()
        for end in (exit_, self._entry):
            end.setblocking(False)
        super().__init__(exit_.detach(), f"can:virtual:{channel}")
        self._bus = _buses.setdefault(channel, [])
        self._bus.append(self)

    def write(self, data: bytes) -> int:
        """Send whole records to all other ends; return the bytes that they accepted. Raises DeviceError if closed."""
        if self._fd < 0:
            raise self._lost_error(None)
        for start in range(0, len(data), READ_SIZE):  # a socket takes so few bytes as a whole, or none of them
            for other in tuple(self._bus):
                if other is not self and not other.takes(data[start : start + READ_SIZE]):
                    return start
        return len(data)

    def takes(self, records: bytes) -> bool:
        """Store records for this end to read; return whether there was room. A closed end takes any."""
        try:
            self._entry.send(records)
        except BlockingIOError:
            return False
        except OSError:  # it was closed in another thread
            return True
        return True

    def close(self) -> None:
        """Leave the bus. May be called twice."""
        if self in self._bus:
            self._bus.remove(self)
        self._entry.close()
        super().close()
