"""CAN buses as wires: they carry records of `hil.links.wires.can_frame`, one whole record for each frame.

    SocketCanWire    a bus of the Linux kernel, can0 or vcan0, without any package: its sockets use these records
    SlcanWire, SocketcandWire    adapters and servers that write frames as text, see `hil.links.wires.text_can_bus`
    VirtualCanWire, MulticastCanWire    buses within this process and this machine, also without any package
    PythonCanWire    any other interface of the python-can package, see `hil.links.wires.python_can_bus`

None blocks, and none returns the frames that it sent itself. A full queue refuses whole frames. Frames that are not
classic data frames (remote and error frames, CAN FD) are ignored.
"""

import errno
import os
import socket
import sys

from hil.common.errors import DeviceError
from hil.links.wires.can_frame import ERROR, RECORD_SIZE
from hil.links.wires.terminal import DescriptorWire

BITRATE = 1_000_000  # bit/s
MAX_FRAMES = 256  # in one read

# linux/can/raw.h, linux/can/error.h; the socket module does not have the second one
CAN_RAW_ERR_FILTER = getattr(socket, "CAN_RAW_ERR_FILTER", 2)
CAN_ERR_BUSOFF = 0x40
UP = "sudo ip link set {0} up type can bitrate 1000000"


class SocketCanWire(DescriptorWire):
    """A CAN socket of the kernel, from `open_socketcan`; any socket that preserves message boundaries works."""

    record_size = RECORD_SIZE

    def read(self) -> bytes:
        """Return the received frames (256 at most), or b"". Raises DeviceError if the bus is down or off."""
        records: list[bytes] = []
        while len(records) < MAX_FRAMES:
            try:
                record = os.read(self._fd, RECORD_SIZE)
            except BlockingIOError:
                break
            except OSError as error:
                raise self._lost_error(error.strerror) from None
            if not record:
                raise self._lost_error("the other end closed")
            if _is_bus_off(record):
                raise self._lost_error("bus-off: check wiring, termination and that all use one bitrate")
            records.append(record)
        return b"".join(records)

    def write(self, data: bytes) -> int:
        """Send whole records; return the bytes accepted by the queue. Raises DeviceError if the bus is down or off."""
        for start in range(0, len(data), RECORD_SIZE):
            try:
                os.write(self._fd, data[start : start + RECORD_SIZE])
            except OSError as error:
                if error.errno in (errno.EAGAIN, errno.ENOBUFS):  # the socket's queue, the interface's queue
                    return start
                raise self._lost_error(error.strerror) from None
        return len(data)

    def _lost_error(self, reason: str | None) -> DeviceError:
        if self._fd < 0:
            return super()._lost_error(reason)
        interface = self.name.rpartition(":")[2]
        return DeviceError(f"{self.name}: went away ({reason}); bring it up again: {UP.format(interface)}")


def open_socketcan(interface: str) -> SocketCanWire:
    """Open the kernel's CAN interface of that name ("can0"); its bitrate is set when it is brought up.

    Raises DeviceError if the kernel has no CAN, the interface does not exist, or it is down.
    """
    name = f"can:socketcan:{interface}"
    try:
        opened = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    except OSError:
        raise DeviceError(f"{name}: this kernel has no CAN; try: sudo modprobe can_raw") from None
    try:
        opened.bind((interface,))
        opened.setsockopt(socket.SOL_CAN_RAW, CAN_RAW_ERR_FILTER, CAN_ERR_BUSOFF)
        opened.setblocking(False)
        down = opened.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)  # set by a bind to an interface that is down
        if down:
            raise OSError(down, os.strerror(down))
    except OSError as error:
        opened.close()
        fault = "no such interface" if error.errno == errno.ENODEV else error.strerror
        raise DeviceError(f"{name}: {fault}; bring it up: {UP.format(interface)}") from None
    return SocketCanWire(opened.detach(), name)


def _is_bus_off(record: bytes) -> bool:
    marked_id = int.from_bytes(record[:4], sys.byteorder)
    return bool(marked_id & ERROR and marked_id & CAN_ERR_BUSOFF)
