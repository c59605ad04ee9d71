"""The contract of thruster links on CAN buses: each wire, and VESC on buses without another test."""

from typing import ClassVar

from hil.links.contract import Wire
from hil.links.wires.can_frame import RECORD_SIZE
from hil.links.wires.faults import FaultyWire
from tests.support.links.can_pairs import mcast_pair, python_can_pair, slcan_pair, socket_pair, virtual_pair
from tests.support.links.link_contract import CanLinkContract, WireContract


def faultless_pair() -> tuple[Wire, Wire]:
    device, host = socket_pair()
    return FaultyWire(device), FaultyWire(host)


class CanContract(WireContract):
    record_size = RECORD_SIZE
    host_sees_hangup = False


class TestSocketCan(CanContract):
    open_wires = staticmethod(socket_pair)
    host_sees_hangup = True  # the stand-in for a CAN socket has one


class TestVirtualCan(CanContract):
    open_wires = staticmethod(virtual_pair)


class Vesc(CanLinkContract):
    """Each motor controller reports for itself: the rest of a report the host makes up."""

    protocol = "vesc"
    channels: ClassVar[tuple[int, ...]] = (1, 8)
    commands_carry = ("armed", "pwm_us")
    reports_carry = ("sequence", "armed", "timed_out", "pwm_us")


class TestVescOnFaultlessCan(Vesc):
    open_wires = staticmethod(faultless_pair)
    host_sees_hangup = True


class TestVescOnPythonCan(Vesc):
    open_wires = staticmethod(python_can_pair)
    refuses_when_full = False


class TestVescOnMcast(Vesc):
    open_wires = staticmethod(mcast_pair)
    refuses_when_full = False


class TestVescOnSlcan(Vesc):
    open_wires = staticmethod(slcan_pair)
    refuses_when_full = False
    quiet_s = 0.5  # adapters in between hold much
