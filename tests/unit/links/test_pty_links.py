"""The link contract on pseudo terminals, with each way a host opens one, and on wires that inject no faults."""

from hil.links.contract import Wire
from hil.links.wires.faults import FaultyWire
from hil.links.wires.terminal import PtyHostWire, PtyWire, UartWire
from tests.support.links.link_contract import LinkContract


def lean_pair() -> tuple[Wire, Wire]:
    device = PtyWire()
    return device, PtyHostWire(device.path)


def pyserial_pair() -> tuple[Wire, Wire]:
    device = PtyWire()
    return device, UartWire(device.path, 921_600)


def faultless_pair() -> tuple[Wire, Wire]:
    device = PtyWire()
    return FaultyWire(device), FaultyWire(PtyHostWire(device.path))


class TestPty(LinkContract):
    open_wires = staticmethod(lean_pair)


class TestUartOnPty(LinkContract):
    open_wires = staticmethod(pyserial_pair)


class TestFaultlessPty(LinkContract):
    open_wires = staticmethod(faultless_pair)
