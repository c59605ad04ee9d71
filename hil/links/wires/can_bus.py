"""CAN buses as wires: they carry records of `hil.links.wires.can_frame`, one whole record for each frame.

    SocketCanWire    a bus of the Linux kernel, can0 or vcan0, without any package: its sockets use these records
    SlcanWire        an adapter with the Lawicel text protocol, on any wire of bytes, usually a serial device
    PythonCanWire    any other interface of the python-can package, see `hil.links.wires.python_can_bus`

None blocks, and none returns the frames that it sent itself. A full queue refuses whole frames. Frames that are not
classic data frames (remote and error frames, CAN FD) are ignored.
"""

import contextlib
import errno
import os
import socket
import sys
from binascii import Error as HexError
from binascii import unhexlify

from hil.common.errors import ConfigError, DeviceError
from hil.links.contract import Wire
from hil.links.wires.can_frame import ERROR, MAX_DATA, RECORD_SIZE, CanFrame, pack_frame, unpack_frames
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


class SlcanWire(Wire):
    """A CAN adapter with the Lawicel text protocol ("slcan") on `line`, a wire of bytes that it then owns.

    bitrate: of the bus, bit/s, one of `BITRATES`. The adapter is closed, configured and opened. Its answers to this and
    to each frame are ignored, because adapters differ in them. Raises ConfigError for another bitrate, DeviceError if
    the line is lost.
    """

    record_size = RECORD_SIZE
    BITRATES = (10_000, 20_000, 50_000, 100_000, 125_000, 250_000, 500_000, 800_000, 1_000_000)  # S0 to S8
    LONGEST_LINE = 32  # characters: T, identifier, size, 16 of data, 4 of time, and a margin

    def __init__(self, line: Wire, bitrate: int = BITRATE) -> None:
        self.name = f"can:slcan:{line.name}"
        if bitrate not in self.BITRATES:
            line.close()
            raise ConfigError(f"{self.name}: {bitrate} bit/s is not one of {', '.join(map(str, self.BITRATES))}")
        self._line = line
        self._unread = b""  # start of an incomplete line
        self._unsent = b"\rC\rS%d\rO\r" % self.BITRATES.index(bitrate)
        self._flush()

    def fileno(self) -> int:
        """Return the line's descriptor."""
        return self._line.fileno()

    def read(self) -> bytes:
        """Return the received frames, or b"". Raises DeviceError if the adapter is lost."""
        self._flush()
        return self._records(self._line.read())

    def discard_received(self) -> int:
        """Discard the received lines; return the number of their characters."""
        self._unread = b""
        return self._line.discard_received()

    def write(self, data: bytes) -> int:
        """Send whole records; return the bytes that the line accepted. Raises DeviceError when the adapter is lost."""
        for start in range(0, len(data), RECORD_SIZE):
            for frame in unpack_frames(data[start : start + RECORD_SIZE]):
                if not self._flush():
                    return start
                self._unsent = _line_of_frame(frame)
        self._flush()
        return len(data)

    def unsent(self) -> int:
        """Return the number of characters that wait here or in the line."""
        return len(self._unsent) + self._line.unsent()

    def discard_unsent(self) -> None:
        """Discard what the line has not sent; send an end of line first, as a line may have been cut."""
        self._line.discard_unsent()
        self._unsent = b"\r"

    def close(self) -> None:
        """Close the adapter's bus and the line. May be called twice."""
        with contextlib.suppress(DeviceError):
            self._line.write(b"\rC\r")
        self._line.close()

    def _records(self, text: bytes) -> bytes:
        """Return the frames whose lines are complete with `text`."""
        *lines, self._unread = (self._unread + text).replace(b"\a", b"\r").split(b"\r")
        self._unread = self._unread[-self.LONGEST_LINE :]
        return b"".join([_record_of_line(line) for line in lines])

    def _flush(self) -> bool:
        """Send the rest of a line that the wire has cut; return whether all is sent."""
        taken = self._line.write(self._unsent) if self._unsent else 0
        self._unsent = self._unsent[taken:]
        return not self._unsent


def _line_of_frame(frame: CanFrame) -> bytes:
    mark, digits = ("T", 8) if frame.extended else ("t", 3)
    return f"{mark}{frame.id:0{digits}X}{len(frame.data)}{frame.data.hex().upper()}\r".encode()


def _record_of_line(line: bytes) -> bytes:
    """Return the record of a line; b"" for an acknowledgement or noise."""
    mark = line[:1]
    if mark not in (b"t", b"T"):
        return b""
    digits = 9 if mark == b"T" else 4
    try:
        identifier, size = int(line[1:digits], 16), int(line[digits : digits + 1])
        data = unhexlify(line[digits + 1 : digits + 1 + 2 * size])
    except (ValueError, HexError):
        return b""
    limit = 1 << (29 if mark == b"T" else 11)
    if len(data) != size or size > MAX_DATA or not 0 <= identifier < limit:
        return b""
    return pack_frame(CanFrame(identifier, data, mark == b"T"))
