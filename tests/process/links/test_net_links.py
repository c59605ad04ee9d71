"""The contract of thruster links on TCP and UDP."""

from hil.links.contract import Wire
from hil.links.wires.net import TcpHostWire, TcpWire, UdpHostWire, UdpWire
from tests.support.links.link_contract import LinkContract, wait_readable


def tcp_pair() -> tuple[Wire, Wire]:
    device = TcpWire()
    host = TcpHostWire("127.0.0.1", device.port)
    receive_greeting(device)
    return device, host


def udp_pair() -> tuple[Wire, Wire]:
    device = UdpWire()
    host = UdpHostWire("127.0.0.1", device.port)
    receive_greeting(device)
    return device, host


def receive_greeting(device: Wire) -> None:
    assert wait_readable(device), "the device's loop must wake for a host"
    assert device.read() == b""


class TestTcp(LinkContract):
    open_wires = staticmethod(tcp_pair)


class TestUdp(LinkContract):
    open_wires = staticmethod(udp_pair)
    host_sees_hangup = False
    refuses_when_full = False
