"""One SeaTrac beacon, and its serial protocol: lines of little endian bytes as hexadecimal digits, with a CRC-16.

What is public leaves something open: here the time of a range is one way, and an elevation is positive above the
beacon's plane.
"""

from collections.abc import Callable
from math import asin, atan2, degrees, hypot, log10, radians
from struct import pack
from typing import Any, NamedTuple

from hil.common.clock import NEVER_NS, NS_PER_MS, NS_PER_S
from hil.common.vectors import Quaternion, Vector3
from hil.instruments.layout import read_device, read_messages
from hil.links.frame.checksums import CRCS, crc_checksum
from sim.rotations import from_euler, rotate, rotate_inverse, to_euler

_CRC = crc_checksum(CRCS["crc16-arc"])
_RANGE, _USBL, _POSITION, _ENHANCED = 1, 2, 4, 8  # flags of a fix
_SOURCE_LEVEL = 176.0  # dB re 1 uPa at 1 m (X150, data sheet)
_COUNTER = 16_000.0  # Hz
_X150, _X110 = 795, 843  # part numbers
_PERIODS_MS = (0, 1000, 400, 200, 100, 40)  # by mode of the status; 0: on request only
_REBOOT = b"\x95\x6a"
_MOST_QUEUED = 30  # bytes


class Cid:
    """Commands, and what a beacon reports."""

    SYS_ALIVE, SYS_INFO, SYS_REBOOT = 0x01, 0x02, 0x03
    STATUS, STATUS_CFG_GET, STATUS_CFG_SET = 0x10, 0x11, 0x12
    SETTINGS_GET, SETTINGS_SET, SETTINGS_LOAD, SETTINGS_SAVE, SETTINGS_RESET = 0x15, 0x16, 0x17, 0x18, 0x19
    XCVR_FIX, XCVR_STATUS = 0x39, 0x3A
    PING_SEND, ECHO_SEND, NAV_QUERY_SEND, DAT_SEND = 0x40, 0x48, 0x50, 0x60
    DAT_QUEUE_SET, DAT_QUEUE_CLR, DAT_QUEUE_STATUS = 0x64, 0x65, 0x66


class Cst:
    """Results of commands, and states of the transceiver."""

    OK, PARAM_MISSING, PARAM_INVALID = 0x00, 0x04, 0x05
    BUSY, TIMEOUT, IDLE, REQUESTING = 0x30, 0x34, 0x3B, 0x3D


# Kinds of acoustic messages; a response has the number of its request plus 1.
ONE_WAY, ONE_WAY_USBL, REQUEST, REQUEST_USBL, REQUEST_DEPTH = 0, 1, 2, 4, 6
_WITH_ANGLES = (ONE_WAY_USBL, REQUEST_USBL + 1, REQUEST_DEPTH + 1)
SUPPLY_MV = 12_000
_DONE, _INVALID = bytes((Cst.OK,)), bytes((Cst.PARAM_INVALID,))


def encode_line(payload: bytes) -> bytes:
    """Return a beacon's line."""
    return b"$" + (payload + pack("<H", _CRC.of(payload))).hex().upper().encode() + b"\r\n"


def decode_line(line: bytes) -> bytes:
    """Return the bytes of a client's line, b"" of a malformed one."""
    try:
        data = bytes.fromhex(line[1:].decode("ascii"))
    except ValueError:
        return b""
    is_sound = line[:1] == b"#" and data[-2:] == pack("<H", _CRC.of(data[:-2]))
    return data[:-2] if is_sound else b""


_DEVICE = read_device("seatrac")
SETTINGS = read_messages(_DEVICE["records"])[0]
AUTO_SOUND_SPEED, USE_ATTITUDE, REPORT_FIXES = 1, 1, 0x40  # bits of `environment` and of `flags`


class Place(NamedTuple):
    """Where a beacon is: position (NED, m), attitude, and the speed of sound (m/s) that it computes with."""

    position: Vector3
    attitude: Quaternion
    sound_speed: float

    @property
    def depth(self) -> float:
        """Depth in m."""
        return self.position[2]


def deci(value: float) -> int:
    """Return a value in tenths, within 16 bits."""
    return max(-32_768, min(32_767, round(10.0 * value)))


def attitude(of: Quaternion) -> bytes:
    """Return yaw, pitch and roll."""
    roll, pitch, yaw = to_euler(of)
    return pack("<3h", round(10.0 * degrees(yaw) % 3600.0), deci(degrees(pitch)), deci(degrees(roll)))


def encode_fix(
    ids: tuple[int, int], kind: int, here: Place, relative: Vector3, turnaround: float, assumed: Quaternion | None,
    remote_depth: float,
) -> bytes:  # fmt: skip
    """Return the record of an acoustic fix (ACOFIX).

    `ids` are receiver and sender; `relative` (NED, m) is the measured way to the sender, `turnaround` (s) the other's.
    A receiver with a USBL head computes the position with the `assumed` attitude, and of an enhanced response takes the
    `remote_depth` (m) that that carries; one without has None.
    """
    has_range, has_usbl = bool(kind & 1) and kind != ONE_WAY_USBL, assumed is not None and kind in _WITH_ANGLES
    has_position = has_range and has_usbl
    is_enhanced = has_position and kind == REQUEST_DEPTH + 1
    distance = hypot(*relative)
    flags = _RANGE * has_range | _USBL * has_usbl | _POSITION * has_position | _ENHANCED * is_enhanced
    strength = deci(_SOURCE_LEVEL - 20.0 * log10(max(1.0, distance)))
    data = pack("<4B", *ids, flags, kind) + attitude(here.attitude)
    data += pack("<HHh", max(0, deci(here.depth)), round(10.0 * here.sound_speed), strength)
    if has_range:
        seconds = distance / here.sound_speed
        counts = round((2.0 * seconds + turnaround) * _COUNTER)
        data += pack("<IiH", counts, round(1e7 * seconds), min(65_535, round(10.0 * distance)))
    x, y, z = rotate_inverse(here.attitude, relative)
    if has_usbl:
        azimuth = round(10.0 * degrees(atan2(y, x)) % 3600.0)
        elevation = deci(degrees(asin(max(-1.0, min(1.0, -z / distance)))) if distance else 0.0)
        data += pack("<B4hhh2x", 4, *[strength] * 4, azimuth, elevation)
    if has_position and assumed:
        north, east, down = rotate(assumed, (x, y, z))
        data += pack("<3h", deci(east), deci(north), deci(remote_depth if is_enhanced else here.depth + down))
    return data


class Beacon:
    """The beacon of an end. `memory` keeps its saved settings; `has_head` is true for an X150, which measures angles.

    `queue` are the data for the next request of the other.
    """

    def __init__(self, end: str, memory: dict[str, Any], number: int, has_head: bool) -> None:
        values = {
            key: bytes.fromhex(each) if isinstance(each, str) else each for key, each in _DEVICE["values"].items()
        }
        self._memory, self._default = memory, values | {"beacon": number}
        self.end, self.has_head = end, has_head
        self.queue = b""
        self.reboot(0)

    def reboot(self, now_ns: int) -> None:
        """Begin again with the saved settings."""
        self._began_ns, self.busy_until_ns = now_ns, 0
        self._apply(self._memory.get("settings", self._default), now_ns)

    def _apply(self, settings: dict[str, Any] | None, now_ns: int) -> bytes:
        """Take settings; return the result."""
        if settings is None:
            return bytes((Cst.PARAM_MISSING,))
        if not all(low <= settings[name] <= high for name, (low, high) in _DEVICE["limits"].items()):
            return _INVALID
        self.settings = settings
        self.status_due_ns = now_ns if settings["status_mode"] else NEVER_NS
        return _DONE

    def is_status_due(self, now_ns: int) -> bool:
        """Return whether it is time for the status, and set the time of the next."""
        if now_ns < self.status_due_ns:
            return False
        period_ns = _PERIODS_MS[self.settings["status_mode"]] * NS_PER_MS
        self.status_due_ns += period_ns * (1 + (now_ns - self.status_due_ns) // period_ns)
        return True

    def assumed(self, true: Quaternion) -> Quaternion:
        """Return the attitude with which positions are computed: its own, or the one that is set."""
        if self.settings["flags"] & USE_ATTITUDE:
            return true
        return from_euler(*[radians(0.1 * self.settings[name]) for name in ("roll", "pitch", "yaw")])

    def status(self, here: Place, pressure: float, temperature: float, now_ns: int) -> bytes:
        """Return the status with the parts that are switched on; `pressure` in Pa, `temperature` in °C."""
        output = self.settings["status_output"]
        data = pack("<BBQ", Cid.STATUS, output, (now_ns - self._began_ns) // NS_PER_MS)
        if output & 1:
            environment = round(10.0 * temperature), round(pressure / 100.0), round(10.0 * here.depth)
            data += pack("<HhiiH", SUPPLY_MV, *environment, round(10.0 * here.sound_speed))
        if output & 2:
            data += attitude(here.attitude)
        if output & 4:
            data += pack("<BBIB", 100, 1, self._seconds(now_ns), 100)
        if output & 8:
            data += self.settings["calibration"][:12]
        return data

    def _seconds(self, now_ns: int) -> int:
        return (now_ns - self._began_ns) // NS_PER_S

    def answer(self, command: int, payload: bytes, now_ns: int) -> bytes | None:
        """Return the answer to a command that needs no sound; None to others."""
        values, kept, destination = self.settings, self._memory, payload[:1] or b"\0"
        status = {**values, "status_output": payload[0], "status_mode": payload[1]} if len(payload) > 1 else None
        answers: dict[int, Callable[[], bytes]] = {
            Cid.SYS_ALIVE: lambda: pack("<I", self._seconds(now_ns)),
            Cid.SYS_INFO: lambda: self._information(now_ns),
            Cid.SYS_REBOOT: lambda: self._restart(payload, now_ns),
            Cid.XCVR_STATUS: lambda: bytes((Cst.REQUESTING if now_ns < self.busy_until_ns else Cst.IDLE,)),
            Cid.STATUS_CFG_GET: lambda: bytes((values["status_output"], values["status_mode"])),
            Cid.STATUS_CFG_SET: lambda: self._apply(status, now_ns),
            Cid.SETTINGS_GET: lambda: SETTINGS.pack(values),
            Cid.SETTINGS_SET: lambda: self._apply(SETTINGS.unpack(payload), now_ns),
            Cid.SETTINGS_LOAD: lambda: self._apply(kept.get("settings", self._default), now_ns),
            Cid.SETTINGS_SAVE: lambda: kept.update(settings=values) or _DONE,
            Cid.SETTINGS_RESET: lambda: self._apply(self._default, now_ns),
            Cid.DAT_QUEUE_SET: lambda: self._enqueue(payload),
            Cid.DAT_QUEUE_CLR: lambda: self._enqueue(destination + b"\0")[:2],
            Cid.DAT_QUEUE_STATUS: lambda: destination + bytes((len(self.queue),)),
        }
        return bytes((command,)) + answers[command]() if command in answers else None

    def _information(self, now_ns: int) -> bytes:
        part, number = _X150 if self.has_head else _X110, 1000 + self.settings["beacon"]
        data = pack("<IBHBIHH", self._seconds(now_ns), 1, part, 4, number, 0, 0)
        return data + pack("<BHBBHI", 1, 795, 2, 4, 2097, 0) * 2 + b"\1"  # firmware of both processors

    def _restart(self, payload: bytes, now_ns: int) -> bytes:
        if payload != _REBOOT:
            return _INVALID
        self.reboot(now_ns)
        return _DONE

    def _enqueue(self, payload: bytes) -> bytes:
        """Take data that wait for the other's request; the destination is not told apart."""
        if len(payload) < 2 or len(payload) < 2 + payload[1] or payload[1] > _MOST_QUEUED:
            return _INVALID + bytes(2)
        self.queue = payload[2 : 2 + payload[1]]
        return _DONE + payload[:1] + bytes((len(self.queue),))
