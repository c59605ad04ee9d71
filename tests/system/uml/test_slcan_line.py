"""A serial port as a CAN interface by the kernel's line discipline, as `slcand` makes it.

The other end of the port is a SlcanWire: frames have the same form in both directions, and each end
ignores the commands that the other sends to an adapter.
"""

import contextlib
import fcntl
import os
import struct
import tty
from collections.abc import Iterator

import pytest

from hil.common.errors import DeviceError
from hil.links.contract import Wire
from hil.links.wires.can_bus import SocketCanWire, open_socketcan
from hil.links.wires.can_frame import RECORD_SIZE, CanFrame, pack_frame, unpack_frames
from hil.links.wires.terminal import DescriptorWire
from hil.links.wires.text_can_bus import SlcanWire
from tests.support.links.can_pairs import until
from tests.support.links.link_contract import nothing_leaks, read_bytes, wait_readable
from tests.system.uml.network import ip
from tests.unit.links.test_vesc import Vesc

pytestmark = pytest.mark.usefixtures("guest")

TIOCSETD, N_TTY, N_SLCAN, SIOCGIFNAME = 0x5423, 0, 17, 0x8910  # asm-generic/ioctls.h, linux/tty.h, linux/sockios.h


class LineWire(SocketCanWire):
    """The interface that the kernel makes of a terminal; closing restores the terminal."""

    def __init__(self, terminal: int) -> None:
        self._terminal = terminal
        tty.setraw(terminal)
        os.write(terminal, b"C\rS8\rO\r")
        fcntl.ioctl(terminal, TIOCSETD, struct.pack("i", N_SLCAN))
        self.interface = fcntl.ioctl(terminal, SIOCGIFNAME, bytes(32)).split(b"\0")[0].decode()
        ip(f"link set {self.interface} txqueuelen 1000 up")
        wire = open_socketcan(self.interface)
        super().__init__(os.dup(wire.fileno()), wire.name)
        wire.close()

    def close(self) -> None:
        super().close()
        if self._terminal >= 0:
            with contextlib.suppress(OSError):  # the other end may be gone
                fcntl.ioctl(self._terminal, TIOCSETD, struct.pack("i", N_TTY))
                os.write(self._terminal, b"C\r")
            os.close(self._terminal)
            self._terminal = -1


def port() -> tuple[Wire, LineWire]:
    """Return an adapter's side of a serial port, and the interface on the other."""
    master, terminal = os.openpty()
    os.set_blocking(master, False)
    return DescriptorWire(master, "adapter"), LineWire(terminal)


def line_pair() -> tuple[Wire, Wire]:
    adapter, host = port()
    assert read_bytes(adapter, 7) == b"C\rS8\rO\r"
    return SlcanWire(adapter), host


class TestVescOnLine(Vesc):
    open_wires = staticmethod(line_pair)
    host_sees_hangup = True
    refuses_when_full = False  # the kernel takes whatever the line brings


@pytest.fixture
def line() -> Iterator[tuple[Wire, LineWire]]:
    with nothing_leaks():
        adapter, wire = port()
        yield adapter, wire
        wire.close()
        adapter.close()


def test_frames_are_sent_and_received_as_slcan_lines(line: tuple[Wire, LineWire]) -> None:
    adapter, wire = line
    wire.write(pack_frame(CanFrame(0x7FF, b"\x01\x02\x03", extended=False)))
    wire.write(pack_frame(CanFrame(0x1FFF_FFFF, bytes(range(8)))))
    sent = b"C\rS8\rO\rt7FF3010203\rT1FFFFFFF80001020304050607\r"
    assert read_bytes(adapter, len(sent)) == sent
    adapter.write(b"z\rt0000\rnoise\rT0000000F1AA\r")
    received = list(unpack_frames(read_bytes(wire, 2 * RECORD_SIZE)))
    assert received == [CanFrame(0, b"", extended=False), CanFrame(0xF, b"\xaa")]
    wire.close()
    assert read_bytes(adapter, 2)[:2] == b"C\r"


def test_an_interface_that_was_down_works_again(line: tuple[Wire, LineWire]) -> None:
    adapter, wire = line
    ip(f"link set {wire.interface} down")
    with pytest.raises(DeviceError, match=rf"^can:socketcan:{wire.interface}: went away \(Network is down\)"):
        wire.read()
    ip(f"link set {wire.interface} up")
    adapter.write(b"t00F1AA\r")
    assert list(unpack_frames(read_bytes(wire, RECORD_SIZE))) == [CanFrame(0xF, b"\xaa", extended=False)]


def test_an_unplugged_adapter_removes_its_interface(line: tuple[Wire, LineWire]) -> None:
    adapter, wire = line
    adapter.close()
    assert wait_readable(wire)
    with pytest.raises(DeviceError, match="went away"):
        wire.read()
    until(lambda: not os.path.exists(f"/sys/class/net/{wire.interface}"))
    with pytest.raises(DeviceError, match="no such interface"):
        open_socketcan(wire.interface)
