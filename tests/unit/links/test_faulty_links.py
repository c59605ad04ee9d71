"""The link contract on a fault-injecting wire without faults, which must be transparent."""

from hil.links.contract import Wire
from hil.links.wires.faults import FaultyWire
from hil.links.wires.terminal import PtyHostWire, PtyWire
from tests.support.links.link_contract import LinkContract


def faultless_pair() -> tuple[Wire, Wire]:
    device = PtyWire()
    return FaultyWire(device), FaultyWire(PtyHostWire(device.path))


class TestFaultlessPty(LinkContract):
    open_wires = staticmethod(faultless_pair)
