"""MAVLink packets in a stream of bytes: find, check, sign and pack them.

pymavlink encodes and decodes, except pulse widths (see servos.py). It is not used for

    finding packets   its parser waits for the end of anything that looks like a start, and so loses the packets
                      after a cut one. Here a packet is decoded as soon as its last byte is received, and at most
                      one incomplete packet (280 bytes) is stored.
    signatures        its check stores a packet's timestamp before it has checked the signature, so one forged
                      packet blocks a stream for good. Here a timestamp counts only with a valid signature.
"""

import hashlib
from collections.abc import Callable
from hmac import compare_digest
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.links.contract import Counters
from hil.links.mavlink import servos
from hil.links.mavlink.servos import HEADER_SIZE, MARKER
from hil.links.search import find_frames

CRC_SIZE = 2
MARKER_1, HEADER_SIZE_1 = b"\xfe", 6  # of MAVLink 1
SIGNED = 0x01  # the only incompatibility flag
SIGNATURE_SIZE = 13  # link id, timestamp, hash
HASH_SIZE = 6
TIMESTAMP_START_NS = 1_420_070_400 * 10**9  # 2015-01-01, ns since 1970
TIMESTAMP_NS = 10_000  # a timestamp counts 10 us
NEW_STREAM_SLACK = 6_000_000  # in units of a timestamp; a new sender may be a minute behind

# message id -> the byte that its layout adds to the checksum
CRC_EXTRA = {number: bytes([kind.crc_extra]) for number, kind in dialect.mavlink_map.items() if number >= 0}


def signing_secret(text: str) -> bytes:
    """Return the 32 bytes of a key written as 64 hexadecimal digits, or the SHA-256 of a passphrase."""
    try:
        if len(text) == 64:
            return bytes.fromhex(text)
    except ValueError:
        pass
    return hashlib.sha256(text.encode()).digest()


class Stamps:
    """The newest timestamp of a signed packet from each sender: link id, system, component.

    All streams with one key share it, or a packet that one has accepted could be sent to another one again.
    """

    def __init__(self) -> None:
        self.newest: dict[tuple[int, int, int], int] = {}

    def accept(self, sender: tuple[int, int, int], timestamp: int, own: int) -> bool:
        """Return whether a packet is newer than all before; `own` is the timestamp here, for a new sender."""
        if timestamp <= self.newest.get(sender, own - NEW_STREAM_SLACK - 1):
            return False
        self.newest[sender] = timestamp
        return True


class _SafeMavlink(dialect.MAVLink):  # type: ignore[misc]  # pymavlink has no type information
    """Encoder and decoder of pymavlink for one end, with our check of signatures."""

    def sign(self, secret: bytes, wall_clock: Callable[[], int], stamps: Stamps, link: int) -> None:
        """Sign outgoing packets, and refuse incoming ones without a valid signature; RADIO_STATUS is never signed."""
        self._wall_clock = wall_clock
        self._stamps = stamps
        self.signing.link_id = link & 0xFF
        self.signing.secret_key = secret
        self.signing.sign_outgoing = True
        self.signing.allow_unsigned_callback = _may_be_unsigned

    def stop_signing(self) -> None:
        """Stop signing packets and requiring signatures."""
        self.signing.secret_key, self.signing.sign_outgoing = None, False

    def advance(self) -> None:
        """Advance the timestamp to the wall clock; it never goes back, even if the clock does."""
        now = (self._wall_clock() - TIMESTAMP_START_NS) // TIMESTAMP_NS
        self.signing.timestamp = max(self.signing.timestamp, now)

    def check_signature(self, packet: bytearray, system: int, component: int) -> bool:
        """Return whether the signature is valid and its timestamp newer than all before from this sender and link."""
        signing = self.signing
        wanted = hashlib.sha256(signing.secret_key + packet[:-HASH_SIZE]).digest()[:HASH_SIZE]
        if not compare_digest(wanted, bytes(packet[-HASH_SIZE:])):
            return False
        self.advance()
        timestamp = int.from_bytes(packet[-12:-HASH_SIZE], "little")
        sender = (packet[-SIGNATURE_SIZE], system, component)
        if not self._stamps.accept(sender, timestamp, signing.timestamp):
            return False
        signing.timestamp = max(signing.timestamp, timestamp)
        return True


def _may_be_unsigned(_: Any, message_id: int) -> bool:
    return message_id == int(dialect.MAVLINK_MSG_ID_RADIO_STATUS)


class MavlinkStream:
    """Packets of one end; `counters` counts dropped, damaged and refused ones.

    With `takes_version_1` packets of MAVLink 1 are read, too, and answered as such. They cannot be signed.
    """

    def __init__(self, system: int, component: int, counters: Counters, takes_version_1: bool = False) -> None:
        self._markers = (MARKER, MARKER_1) if takes_version_1 else (MARKER,)
        self.is_version_1 = False  # whether the last packet received was of MAVLink 1: so are those that are packed
        self._mavlink = _SafeMavlink(None, system, component)
        self._counters = counters
        self._signs = False
        self._incomplete = b""  # start of an incomplete packet

    def sign(self, secret: bytes, wall_clock: Callable[[], int], stamps: Stamps | None = None, link: int = 0) -> None:
        """Sign packets and require signatures from now on; without a secret stop doing so.

        `wall_clock` returns ns since 1970. `stamps` are those of all streams with this key [its own]; `link` is the
        link id of what is sent.
        """
        self._signs = bool(secret)
        if secret:
            self._mavlink.sign(secret, wall_clock, stamps or Stamps(), link)
        else:
            self._mavlink.stop_signing()

    def pack(self, message: Any) -> bytes:
        """Return the packet of a message of the dialect, with the next number; none if MAVLink 1 has no such id."""
        mavlink = self._mavlink
        if self.is_version_1 and message.get_msgId() > 0xFF:
            return b""
        if self._signs:
            mavlink.advance()
        packet: bytes = message.pack(mavlink, force_mavlink1=self.is_version_1)
        mavlink.seq = (mavlink.seq + 1) & 0xFF
        return packet

    def pack_servos(self, time_usec: int, port: int, pulses: list[int]) -> bytes:
        """Return a SERVO_OUTPUT_RAW packet with these 16 pulse widths (us), with the next number."""
        if self._signs:
            return self.pack(dialect.MAVLink_servo_output_raw_message(time_usec, port, *pulses))
        mavlink = self._mavlink
        packet = servos.encode(time_usec, port, pulses, mavlink.seq, mavlink.srcSystem, mavlink.srcComponent)
        mavlink.seq = (mavlink.seq + 1) & 0xFF
        return packet

    def unpack(self, data: bytes) -> list[Any]:
        """Return the messages whose packets `data` completes, in order. Never raises.

        Every byte belongs to a packet, to `dropped_bytes`, or to the incomplete packet that is stored.
        """
        messages = []
        for packet in self._cut(data):
            try:
                messages.append(self._read(packet))
            except dialect.MAVError:  # right checksum, wrong signature
                self._counters.malformed += 1
        return messages

    def _read(self, packet: bytes) -> Any:
        """Return the message in a packet with a right checksum. Raises MAVError for a wrong or missing signature."""
        is_version_1 = packet[:1] == MARKER_1
        has_pulses = packet[7:HEADER_SIZE] == servos.ID_BYTES and not is_version_1
        message = None if has_pulses and not self._signs else self._mavlink.decode(bytearray(packet))
        self.is_version_1 = is_version_1
        return servos.decode(packet) if has_pulses else message

    def _cut(self, data: bytes) -> list[bytes]:
        """Return the packets with a right checksum among the received bytes."""
        buffer = self._incomplete + data
        packets, rest = find_frames(self, buffer, self._counters)
        self._incomplete = buffer[rest:]
        return [buffer[start:end] for start, end in packets]

    def find_start(self, buffer: bytes, position: int) -> int:
        """Return where the next header may begin, as far as known; the buffer's length if nowhere."""
        while (start := self._find_marker(buffer, position)) >= 0:
            header = buffer[start : start + HEADER_SIZE]
            if header[:1] == MARKER_1:
                if len(header) < HEADER_SIZE_1 or header[5] in CRC_EXTRA:
                    return start
                position = start + 1
                continue
            flags_fit = len(header) < 3 or header[2] & ~SIGNED == 0
            if flags_fit and (len(header) < HEADER_SIZE or int.from_bytes(header[7:], "little") in CRC_EXTRA):
                return start
            position = start + 1
        return len(buffer)

    def _find_marker(self, buffer: bytes, position: int) -> int:
        """Return where a marker of a packet is, -1 if nowhere."""
        found = [start for marker in self._markers if (start := buffer.find(marker, position)) >= 0]
        return min(found, default=-1)

    def size_at(self, buffer: bytes, start: int) -> int:
        """Return the size in bytes of the packet at `start`; for an incomplete header, the header's size."""
        if buffer[start : start + 1] == MARKER_1:
            return HEADER_SIZE_1 + (buffer[start + 1] + CRC_SIZE if len(buffer) - start >= HEADER_SIZE_1 else 0)
        if len(buffer) - start < HEADER_SIZE:
            return HEADER_SIZE
        signature = SIGNATURE_SIZE if buffer[start + 2] & SIGNED else 0
        return HEADER_SIZE + buffer[start + 1] + CRC_SIZE + signature

    def is_sound(self, buffer: bytes, start: int, size: int) -> bool:
        """Return whether the checksum of the whole packet at `start` is right."""
        if buffer[start : start + 1] == MARKER_1:
            message_id, end = buffer[start + 5], start + HEADER_SIZE_1 + buffer[start + 1]
        else:
            message_id = int.from_bytes(buffer[start + 7 : start + 10], "little")
            end = start + HEADER_SIZE + buffer[start + 1]
        wanted = int.from_bytes(buffer[end : end + CRC_SIZE], "little")
        return bool(dialect.x25crc(buffer[start + 1 : end] + CRC_EXTRA[message_id]).crc == wanted)
