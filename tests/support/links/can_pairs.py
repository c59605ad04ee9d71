"""Both ends of each kind of CAN wire that needs no hardware."""

import itertools
import os
import socket
import time
from collections.abc import Callable

from hil.links.contract import Wire
from hil.links.wires.can_bus import SocketCanWire
from hil.links.wires.multicast_bus import MulticastCanWire
from hil.links.wires.python_can_bus import PythonCanWire
from hil.links.wires.terminal import UartWire
from hil.links.wires.text_can_bus import SlcanWire
from hil.links.wires.virtual_bus import VirtualCanWire
from tests.support.links.link_contract import read_bytes
from tests.support.links.slcan_adapter import SlcanBus

MCAST = 16 + os.getpid() % 240  # a bus of this process: others run the same tests meanwhile
_names = (f"bus{number}" for number in itertools.count())


def socket_pair() -> tuple[Wire, Wire]:
    """Return sockets that preserve record boundaries, in place of the kernel's CAN sockets."""
    device, host = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    for end in (device, host):
        end.setblocking(False)
    return SocketCanWire(device.detach(), "can:socketcan:can0"), SocketCanWire(host.detach(), "can:socketcan:can0")


def virtual_pair() -> tuple[Wire, Wire]:
    name = next(_names)
    return VirtualCanWire(name), VirtualCanWire(name)


def python_can_pair() -> tuple[Wire, Wire]:
    """Return two ends of python-can's virtual bus, each of which holds 256 frames."""
    name = next(_names)
    ends = PythonCanWire("virtual", name), PythonCanWire("virtual", name)
    for end in ends:
        end._bus.queue.maxsize = 256  # type: ignore[union-attr]
    return ends


def mcast_pair() -> tuple[Wire, Wire]:
    return MulticastCanWire(str(MCAST)), MulticastCanWire(str(MCAST))


def slcan_pair() -> tuple[Wire, Wire]:
    """Return two adapters on one bus, which ends when both are closed."""
    bus = SlcanBus(2)
    device, host = (_AdapterWire(UartWire(path)) for path in bus.paths)
    until(lambda: all(output[-1:] == [b"O"] for output in bus.output))
    for wire in (device, host):
        wire.bus = bus
        read_bytes(wire, 1, 0.01)  # their acknowledgements
    return device, host


class _AdapterWire(SlcanWire):
    bus: SlcanBus

    def close(self) -> None:
        super().close()
        self.bus.leave()


def until(condition: Callable[[], bool]) -> None:
    """Wait until the condition is true."""
    end = time.monotonic() + 60.0
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.001)
