"""The link contract on pseudo terminals, with each of the two ways a host opens one."""

from hil.links.contract import Wire
from hil.links.wires.terminal import PtyHostWire, PtyWire, UartWire
from tests.support.links.link_contract import LinkContract


def lean_pair() -> tuple[Wire, Wire]:
    device = PtyWire()
    return device, PtyHostWire(device.path)


def pyserial_pair() -> tuple[Wire, Wire]:
    device = PtyWire()
    return device, UartWire(device.path, 921_600)


class TestPty(LinkContract):
    open_wires = staticmethod(lean_pair)


class TestUartOnPty(LinkContract):
    open_wires = staticmethod(pyserial_pair)
