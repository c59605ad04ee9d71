"""CAN wires on interfaces of the kernel."""

import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing

import can
import pytest

from hil.common.errors import DeviceError
from hil.links.address import open_address
from hil.links.contract import Wire
from hil.links.wires.can_bus import open_socketcan
from hil.links.wires.can_frame import ERROR, RECORD_SIZE, CanFrame, pack_frame, unpack_frames
from hil.links.wires.python_can_bus import PythonCanWire
from tests.support.busy import retried_when_busy
from tests.support.links.link_contract import WireContract, nothing_leaks, read_bytes, wait_readable
from tests.system.uml.network import interface, ip, shaped
from tests.unit.links.dronecan.test_dronecan_link import DroneCan
from tests.unit.links.test_vesc import Vesc

pytestmark = pytest.mark.usefixtures("guest")

FRAME = CanFrame(0x1AB_CDEF, b"12345678")
# A frame of 8 bytes is 128 bits to tc, and about as many on a bus. So slow that the reader's buffer never fills up.
SHORT_QUEUE = "netem rate 250kbit limit 100"
LONG_QUEUE = "tbf rate 250kbit burst 160 limit 1mb"
ROUNDS = 500


@pytest.fixture(scope="module", autouse=True)
def _buses() -> Iterator[None]:
    """Make a bus and two cables: the queue of one holds 100 frames, of the other all that a socket may send."""
    with ExitStack() as stack:
        stack.enter_context(interface("vcan0", "vcan"))
        for name, how in (("short", SHORT_QUEUE), ("long", LONG_QUEUE)):
            stack.enter_context(interface(f"{name}_a", f"vxcan peer name {name}_b"))
            ip(f"link set {name}_b up")
            for end in "ab":
                stack.enter_context(shaped(f"{name}_{end}", how))
        yield


def on_bus() -> tuple[Wire, Wire]:
    return open_address("can:socketcan:vcan0", "device"), open_address("can:socketcan:vcan0", "host")


def on_bus_by_package() -> tuple[Wire, Wire]:
    return PythonCanWire("socketcan", "vcan0"), PythonCanWire("socketcan", "vcan0")


class TestVesc(Vesc):
    open_wires = staticmethod(on_bus)
    refuses_when_full = False  # a bus that takes no time is never full


class TestDroneCan(DroneCan):
    open_wires = staticmethod(on_bus)
    refuses_when_full = False


class TestThroughThePackage(WireContract):
    open_wires = staticmethod(on_bus_by_package)
    record_size = RECORD_SIZE
    host_sees_hangup = False
    refuses_when_full = False


class TestFullQueue(WireContract):
    """The queue of the interface is full."""

    open_wires = staticmethod(lambda: (open_socketcan("short_a"), open_socketcan("short_b")))
    record_size = RECORD_SIZE
    host_sees_hangup = False


class TestFullSocket(WireContract):
    """The send buffer of the socket is full."""

    open_wires = staticmethod(lambda: (open_socketcan("long_a"), open_socketcan("long_b")))
    record_size = RECORD_SIZE
    host_sees_hangup = False


def test_frames_are_exchanged_with_python_can() -> None:
    wire = open_socketcan("vcan0")
    with can.Bus("vcan0", "socketcan", ignore_config=True) as other:
        for frame in (FRAME, CanFrame(0x7FF, b"", extended=False)):
            wire.write(pack_frame(frame))
            received = other.recv(2.0)
            assert received is not None
            assert CanFrame(received.arbitration_id, bytes(received.data), received.is_extended_id) == frame
            other.send(can.Message(arbitration_id=frame.id, data=frame.data, is_extended_id=frame.extended))
            assert list(unpack_frames(read_bytes(wire, RECORD_SIZE))) == [frame]
        other.send(can.Message(arbitration_id=1, is_remote_frame=True, dlc=2))
        assert list(unpack_frames(read_bytes(wire, RECORD_SIZE))) == []
    assert wire.read() == b""
    wire.close()


def test_an_interface_that_was_down_works_again() -> None:
    with interface("vcan1", "vcan"), nothing_leaks():
        device, host = open_socketcan("vcan1"), open_socketcan("vcan1")
        ip("link set vcan1 down")
        remedy = r"^can:socketcan:vcan1: went away \(Network is down\); bring it up again: sudo ip link set vcan1 up"
        assert wait_readable(host), "a loop that waits must wake up"
        with pytest.raises(DeviceError, match=remedy):
            host.read()
        with pytest.raises(DeviceError, match=remedy):
            device.write(pack_frame(FRAME))
        with pytest.raises(DeviceError, match="sudo ip link set vcan1 up"):
            open_socketcan("vcan1")
        ip("link set vcan1 up")
        again = open_socketcan("vcan1")
        assert again.write(pack_frame(FRAME)) == RECORD_SIZE
        assert read_bytes(host, RECORD_SIZE) == pack_frame(FRAME), "even without opening it again"
        for wire in (device, host, again):
            wire.close()


def test_an_unplugged_interface_is_reported() -> None:
    with interface("vcan1", "vcan"):
        wire = open_socketcan("vcan1")
    assert wait_readable(wire)
    with pytest.raises(DeviceError, match=r"^can:socketcan:vcan1: went away \(No such device"):
        wire.read()
    with pytest.raises(DeviceError, match="went away"):
        wire.write(pack_frame(FRAME))
    wire.close()
    with pytest.raises(DeviceError, match="no such interface"):
        open_socketcan("vcan1")


def test_only_bus_off_ends_the_wire() -> None:
    """The kernel's filter for error frames passes those that it was set to."""
    device, host = on_bus()
    error_warning, bus_off = ((ERROR | kind).to_bytes(4, sys.byteorder) + b"\x08" + bytes(11) for kind in (0x04, 0x40))
    device.write(error_warning + pack_frame(FRAME))
    assert read_bytes(host, RECORD_SIZE) == pack_frame(FRAME)
    device.write(bus_off)
    assert wait_readable(host)
    with pytest.raises(DeviceError, match=r"bus-off: check wiring, .*sudo ip link set vcan0 up"):
        host.read()
    device.close()
    host.close()


@retried_when_busy("medians of three loops, one after the other")
def test_a_round_trip_is_faster_than_through_python_can() -> None:
    """The round-trip times (us) of a frame in one process are printed with -rP."""
    ours, package = median_and_late(*on_bus()), median_and_late(*on_bus_by_package())
    bare = bare_package()
    for name, (median, late) in (("our wire", ours), ("our wire by python-can", package), ("python-can", bare)):
        print(f"{name}: p50 {median:.0f} us, p99 {late:.0f} us")
    assert ours[0] < package[0]
    assert ours[0] < 1.1 * bare[0]


def median_and_late(device: Wire, host: Wire) -> tuple[float, float]:
    record, durations = pack_frame(FRAME), []
    with closing(device), closing(host):
        for _ in range(ROUNDS):
            began = time.perf_counter()
            host.write(record)
            assert wait_readable(device)
            device.write(device.read())
            assert wait_readable(host)
            assert host.read() == record
            durations.append(time.perf_counter() - began)
    return _microseconds(durations)


def bare_package() -> tuple[float, float]:
    message, durations = can.Message(arbitration_id=FRAME.id, data=FRAME.data), []
    with (
        can.Bus("vcan0", "socketcan", ignore_config=True) as device,
        can.Bus("vcan0", "socketcan", ignore_config=True) as host,
    ):
        for _ in range(ROUNDS):
            began = time.perf_counter()
            host.send(message)
            received = device.recv(2.0)
            assert received is not None
            device.send(received)
            assert host.recv(2.0) is not None
            durations.append(time.perf_counter() - began)
    return _microseconds(durations)


def _microseconds(durations: list[float]) -> tuple[float, float]:
    durations.sort()
    return durations[len(durations) // 2] * 1e6, durations[len(durations) * 99 // 100] * 1e6
