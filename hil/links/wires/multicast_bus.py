"""A CAN bus in UDP multicast, in the form of ArduPilot's SITL and DroneCAN's public tools ("mcast:0" there).

Each frame is a datagram to 239.65.82.BUS, port 57732: 0x2934, CRC-16/CCITT-FALSE of what follows, flags (1: CAN FD),
the identifier with bit 31 for one of 29 bits, and the data, all little-endian. Source: dronecan/pydronecan,
dronecan/driver/mcast.py; ArduPilot, libraries/AP_HAL_SITL/CAN_Multicast.cpp.

The bus has no password, so frames stay on this machine: none leaves it, and those of other machines are dropped.
"""

import contextlib
import socket
from binascii import crc_hqx
from struct import Struct, error

from hil.common.errors import ConfigError, DeviceError
from hil.links.contract import Wire
from hil.links.wires.can_bus import MAX_FRAMES
from hil.links.wires.can_frame import EXTENDED, ID_MASK, MAX_DATA, RECORD_SIZE, CanFrame, pack_frame, unpack_frames

PORT = 57_732
MAX_BUS = 255
_HEAD, _BODY = Struct("<HH"), Struct("<HI")
_MAGIC, _CRC_START = 0x2934, 0xFFFF
_LARGEST = 128  # bytes; more than a frame of CAN FD takes
_MAX_PEERS = 256  # addresses whose check is cached
_ANY, _LOOPBACK = "0.0.0.0", "127.0.0.1"


class MulticastCanWire(Wire):
    """The bus with a number from 0 to 255 ("0"). Raises ConfigError for another, DeviceError if it cannot be opened."""

    record_size = RECORD_SIZE

    def __init__(self, number: str) -> None:
        self.name = f"can:mcast:{number}"
        if not (number.isascii() and number.isdigit() and int(number) <= MAX_BUS):
            raise ConfigError(f"{self.name}: the number of a bus is 0 to {MAX_BUS}")
        group = f"239.65.82.{int(number)}"
        self._local: dict[str, bool] = {}
        self._in = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._join(group)
        except OSError as problem:
            self.close()
            raise DeviceError(f"{self.name}: {problem.strerror}; no interface of this machine has multicast") from None
        self._own_port = self._out.getsockname()[1]

    def _join(self, group: str) -> None:
        self._in.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._in.bind((group, PORT))
        membership = socket.inet_aton(group)
        try:  # the system's default interface for multicast, as the other programs use
            self._in.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership + socket.inet_aton(_ANY))
        except OSError:  # no network at all
            loopback = socket.inet_aton(_LOOPBACK)
            self._in.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership + loopback)
            self._out.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, loopback)
        self._out.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
        self._out.connect((group, PORT))
        for each in (self._in, self._out):
            each.setblocking(False)

    def fileno(self) -> int:
        """Return the descriptor to wait on for frames; -1 once closed."""
        return self._in.fileno()

    def read(self) -> bytes:
        """Return the received frames (256 at most), or b"". Raises DeviceError if the bus is lost."""
        records: list[bytes] = []
        for _ in range(MAX_FRAMES):
            try:
                data, (host, port) = self._in.recvfrom(_LARGEST)
            except BlockingIOError:
                break
            except OSError as problem:
                raise self._lost_error(problem) from None
            if port != self._own_port and self._is_local(host):
                records.append(_record_of_datagram(data))
        return b"".join(records)

    def write(self, data: bytes) -> int:
        """Send whole records; return the bytes that were accepted. Raises DeviceError if the bus is lost."""
        for start in range(0, len(data), RECORD_SIZE):
            for frame in unpack_frames(data[start : start + RECORD_SIZE]):
                try:
                    self._out.send(_datagram_of_frame(frame))
                except (BlockingIOError, ConnectionRefusedError):
                    return start
                except OSError as problem:
                    raise self._lost_error(problem) from None
        return len(data)

    def close(self) -> None:
        """Leave the bus. May be called twice."""
        self._in.close()
        self._out.close()

    def _is_local(self, host: str) -> bool:
        """Return whether an address belongs to this machine: a socket cannot be bound to any other."""
        if host not in self._local:
            if len(self._local) >= _MAX_PEERS:
                self._local.clear()
            self._local[host] = False
            with contextlib.suppress(OSError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
                probe.bind((host, 0))
                self._local[host] = True
        return self._local[host]

    def _lost_error(self, problem: OSError) -> DeviceError:
        reason = "is closed; open it again" if self.fileno() < 0 else f"the bus is lost: {problem.strerror}"
        return DeviceError(f"{self.name}: {reason}")


def _datagram_of_frame(frame: CanFrame) -> bytes:
    body = _BODY.pack(0, frame.id | EXTENDED if frame.extended else frame.id) + frame.data
    return _HEAD.pack(_MAGIC, crc_hqx(body, _CRC_START)) + body


def _record_of_datagram(data: bytes) -> bytes:
    """Return the record of a datagram; b"" for a frame of CAN FD, a remote frame, or noise."""
    try:
        magic, checksum = _HEAD.unpack_from(data)
        flags, marked_id = _BODY.unpack_from(data, _HEAD.size)
    except error:
        return b""
    content = data[_HEAD.size + _BODY.size :]
    if magic != _MAGIC or flags or len(content) > MAX_DATA or marked_id & ~(EXTENDED | ID_MASK):
        return b""
    if checksum != crc_hqx(data[_HEAD.size :], _CRC_START):
        return b""
    return pack_frame(CanFrame(marked_id & ID_MASK, content, bool(marked_id & EXTENDED)))
