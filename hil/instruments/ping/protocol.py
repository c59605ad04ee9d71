"""The ping protocol of Blue Robotics and Cerulean: framing, messages as tables, requests and refusals.

A message is 'B' 'R', length of the payload, number, source and destination, payload, and the sum of all bytes before it
modulo 65,536; little-endian. Source: github.com/bluerobotics/ping-protocol, definitions of the common messages.
"""

import struct
from collections.abc import Mapping
from typing import Annotated, Any, NamedTuple

from hil.common.schema import Range
from hil.instruments.contract import Client, Facts, Scene, Send
from hil.instruments.streams import Reader, StreamInstrument

_START = b"BR"
_HEADER = struct.Struct("<2sHHBB")
_SUM = struct.Struct("<H")
_MAX_REQUEST = 256  # bytes of a host's payload; a longer one is noise
_ANY_DEVICE = (0, 255)  # destinations that every device answers to
ACK, NACK, ASCII_TEXT, DEVICE_INFORMATION, PROTOCOL_VERSION, GENERAL_REQUEST = 1, 2, 3, 4, 5, 6
SET_DEVICE_ID = 100
Byte = Annotated[int, Range(0, 255)]


class Frame(NamedTuple):
    """A message as it stands on the wire."""

    number: int
    payload: bytes
    source: int = 0
    destination: int = 0


class Message(NamedTuple):
    """The layout of a message: its fixed fields in order; bytes may follow them if it `has_data`."""

    name: str
    layout: struct.Struct
    fields: tuple[str, ...]
    has_data: bool = False

    def pack(self, values: Mapping[str, Any], data: bytes = b"") -> bytes:
        """Return the payload with the fields' values, and the data."""
        return self.layout.pack(*[values[name] for name in self.fields]) + data

    def unpack(self, payload: bytes) -> dict[str, Any] | None:
        """Return the fields' values by their names; None if the payload has another length."""
        if len(payload) != self.layout.size:
            return None
        return dict(zip(self.fields, self.layout.unpack(payload), strict=True))


def message(name: str, fields: str = "", *, has_data: bool = False) -> Message:
    """Return a layout from `fields`: words "name:format" with the letters of `struct`."""
    pairs = [word.split(":") for word in fields.split()]
    layout = struct.Struct("<" + "".join(letter for _, letter in pairs))
    return Message(name, layout, tuple(field for field, _ in pairs), has_data)


COMMON = {
    DEVICE_INFORMATION: message(
        "device_information",
        "device_type:B device_revision:B firmware_version_major:B firmware_version_minor:B firmware_version_patch:B "
        "reserved:B",
    ),
    PROTOCOL_VERSION: message("protocol_version", "version_major:B version_minor:B version_patch:B reserved:B"),
    GENERAL_REQUEST: message("general_request", "requested_id:H"),
    SET_DEVICE_ID: message("set_device_id", "device_id:B"),
}


def encode(frame: Frame) -> bytes:
    """Return the bytes of a frame."""
    head = _HEADER.pack(_START, len(frame.payload), frame.number, frame.source, frame.destination)
    return head + frame.payload + _SUM.pack((sum(head) + sum(frame.payload)) & 0xFFFF)


class Decoder:
    """Finds the frames in a stream of bytes; what is none, such as the 'U' of an automatic baud rate, is skipped."""

    def __init__(self, longest: int = _MAX_REQUEST) -> None:
        self._buffer = bytearray()
        self._longest = longest
        self.malformed = 0  # frames with a wrong sum or length

    def read(self, data: bytes) -> list[Frame]:
        """Return the frames that `data` completes."""
        buffer, frames, at = self._buffer, [], 0
        buffer += data
        while (at := buffer.find(_START, at)) >= 0 and len(buffer) - at >= _HEADER.size:
            _, length, number, source, destination = _HEADER.unpack_from(buffer, at)
            end = at + _HEADER.size + length
            if length <= self._longest and len(buffer) < end + _SUM.size:
                break
            if length > self._longest or _SUM.unpack_from(buffer, end)[0] != sum(buffer[at:end]) & 0xFFFF:
                self.malformed += 1
                at += len(_START)
                continue
            frames.append(Frame(number, bytes(buffer[at + _HEADER.size : end]), source, destination))
            at = end + _SUM.size
        if at < 0:
            at = len(buffer) - buffer.endswith(_START[:1])
        del buffer[:at]
        return frames


class PingDevice(StreamInstrument):
    """A device of the ping protocol; a device derives from it and fills its tables.

    `readable` are the messages that may be requested, `commands` those that a host may send; `values` are the present
    values of all fields, by the fields' names. The settings have its `firmware`, two or three numbers. A command is
    refused (nack) if a field is outside `limits`, or if `execute` returns why.
    """

    wires = ("udp", "tcp", "serial", "pty")
    automatic = b"U"  # as ping-viewer sends it (src/sensor/protocoldetector.cpp)
    is_interactive = True
    first_id = 1  # its number until another is set
    readable: Mapping[int, Message] = {}
    commands: Mapping[int, Message] = {}
    limits: Mapping[str, tuple[int, int]] = {}
    answered: tuple[str, ...] = ()  # commands whose answer is another message than ack

    def __init__(self, settings: Any, facts: Facts, scene: Scene, send: Send) -> None:
        super().__init__(settings, facts, scene, send)
        major, minor, patch = (*settings.firmware, 0)[:3]
        self.values: dict[str, Any] = {
            "version_major": 1, "version_minor": 0, "version_patch": 0, "reserved": 0, "device_type": 1,
            "device_model": 1, "device_revision": 1, "device_id": facts.memory.get("device_id", self.first_id),
            "firmware_version_major": major, "firmware_version_minor": minor, "firmware_version_patch": patch,
        }  # fmt: skip
        self._hosts: dict[Client, int] = {}  # number of each client, as it gives it

    def disconnected(self, client: Client, now_ns: int) -> None:
        """Forget a client."""
        super().disconnected(client, now_ns)
        self._hosts.pop(client, None)

    def new_reader(self) -> Reader:
        """Return the reader of a client."""
        return Decoder()

    def on_message(self, client: Client, message: Frame, now_ns: int) -> None:
        """Answer a request, or execute a command."""
        if message.destination not in (*_ANY_DEVICE, self.values["device_id"]):
            return
        self._hosts[client] = message.source
        frame, number = message, message.number
        if number == GENERAL_REQUEST:
            requested = COMMON[number].unpack(frame.payload)
            if requested is None:
                self.refuse(client, number, "wrong length")
            else:
                self._answer(client, requested["requested_id"], now_ns)
        elif number in self.commands or number == SET_DEVICE_ID:
            self._command(client, frame, now_ns)
        elif not frame.payload:
            self._answer(client, number, now_ns)  # the older form of a request: the message itself, empty
        else:
            self.refuse(client, number, "unknown message")

    def _answer(self, client: Client, number: int, now_ns: int) -> None:
        if number not in self.readable and number not in (DEVICE_INFORMATION, PROTOCOL_VERSION):
            self.refuse(client, number, "unknown message")
        elif why := self.request(client, number, now_ns):
            self.refuse(client, number, why)

    def _command(self, client: Client, frame: Frame, now_ns: int) -> None:
        layout = self.commands.get(frame.number) or COMMON[frame.number]
        fields = layout.unpack(frame.payload)
        if fields is None:
            self.refuse(client, frame.number, "wrong length")
            return
        for name, value in fields.items():
            low, high = self.limits.get(name, (value, value))
            if not low <= value <= high:
                self.refuse(client, frame.number, f"{name} out of range")
                return
        if layout.name == "set_device_id":
            self.values["device_id"] = self.facts.memory["device_id"] = fields[layout.fields[0]]
            self.acknowledge(client, frame.number)
        elif why := self.execute(client, layout.name, fields, now_ns):
            self.refuse(client, frame.number, why)
        elif layout.name not in self.answered:
            self.acknowledge(client, frame.number)

    def request(self, client: Client, number: int, now_ns: int) -> str:
        """Send a message that was requested; return why not, or ""."""
        self.send_message(number, client)
        return ""

    def execute(self, client: Client, name: str, fields: dict[str, Any], now_ns: int) -> str:
        """Execute the command `name`; return why not, or ""."""
        self.values.update(fields)
        return ""

    def send_message(
        self,
        number: int,
        client: Client | None = None,
        data: bytes = b"",
        values: Mapping[str, Any] | None = None,
        measured_ns: int = 0,
    ) -> None:
        """Send a message with `values`, by default the present ones, to one client or to all that have written."""
        layout = self.readable.get(number) or COMMON[number]
        payload = layout.pack(values or self.values, data if layout.has_data else b"")
        for to in [client] if client else list(self._hosts):
            self._put(to, number, payload, measured_ns)

    def acknowledge(self, client: Client, number: int) -> None:
        """Acknowledge a command."""
        self._put(client, ACK, _SUM.pack(number))

    def refuse(self, client: Client, number: int, why: str) -> None:
        """Refuse a message: `why` is short ASCII text."""
        self._put(client, NACK, _SUM.pack(number) + why.encode("ascii"))

    def _put(self, client: Client, number: int, payload: bytes, measured_ns: int = 0) -> None:
        frame = Frame(number, payload, self.values["device_id"], self._hosts.get(client, 0))
        self.send(encode(frame), client, measured_ns=measured_ns)
