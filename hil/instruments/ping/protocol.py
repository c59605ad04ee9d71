"""The ping protocol of Blue Robotics and Cerulean: framing, requests, settings and refusals.

A message is 'B' 'R', length of the payload, number, source and destination, payload, and the sum of all bytes before it
modulo 65,536; little-endian. Source: github.com/bluerobotics/ping-protocol, definitions of the common messages.
"""

import re
import struct
from typing import Annotated, Any, NamedTuple

from hil.common.schema import Range
from hil.instruments.contract import Client, Frames, Instrument, Reader
from hil.instruments.layout import read_device, read_messages

_START = b"BR"
_HEADER = struct.Struct("<2sHHBB")
_SUM = struct.Struct("<H")
_MAX_REQUEST = 256  # bytes of a host's payload; a longer one is noise
_ANY_DEVICE = (0, 255)  # destinations that every device answers to
ACK, NACK, GENERAL_REQUEST = 1, 2, 6
Byte = Annotated[int, Range(0, 255)]


class Frame(NamedTuple):
    """A message as it stands on the wire."""

    number: int
    payload: bytes
    source: int = 0
    destination: int = 0


def encode(frame: Frame) -> bytes:
    """Return the bytes of a frame."""
    data = _HEADER.pack(_START, len(frame.payload), frame.number, frame.source, frame.destination) + frame.payload
    return data + _SUM.pack(Decoder.checksum.of(data))


class Decoder(Frames):
    """Finds the frames of a client; what is none, such as the 'U' of an automatic baud rate, is skipped."""

    begin = re.compile(rb"BR|B\Z")

    def __init__(self) -> None:
        super().__init__()
        self.host = 0  # number of the client, as it gives it
        self.streams: set[int] = set()  # numbers of the messages that it gets without asking

    def read(self, data: bytes, now_ns: int = 0) -> list[Frame]:
        """Return the frames that `data` completes."""
        found = [(_HEADER.unpack_from(each), each) for each in super().read(data)]
        return [Frame(number, each[8:-2], source, to) for (_, _, number, source, to), each in found]

    def size_at(self, buffer: bytes, start: int) -> int:
        """Return the size of a frame; 0 for a payload that no host sends."""
        length = int.from_bytes(buffer[start + 2 : start + 4], "little")
        return _HEADER.size + length + _SUM.size if length <= _MAX_REQUEST else 0


class PingDevice(Instrument):
    """A device of the ping protocol: mainly its `table`, what may be read, the commands, their limits and values.

    `values` are the present values of all fields, by the fields' names; messages of the numbers `measurements` have
    those of `measured`. `data` follow a message that has data. The settings have the device's `firmware`, two or three
    numbers. A command is refused (nack) if a field is outside its limits, or if `execute` returns why.
    """

    wires = ("udp", "tcp", "serial", "pty")
    automatic = b"U"  # as ping-viewer sends it (src/sensor/protocoldetector.cpp)
    is_interactive = True
    table = ""
    first_id = 1  # its number until another is set
    measurements: tuple[int, ...] = ()
    answered: tuple[str, ...] = ()  # commands whose answer is another message than ack

    def prepare(self) -> None:
        """Set its state at power on."""
        table = read_device(self.table)
        self._readable, self._commands = read_messages(table["readable"]), read_messages(table["commands"])
        self._limits: dict[str, list[int]] = table["limits"]
        self.at_power_on: dict[str, Any] = table["values"]
        major, minor, patch = (*self.settings.firmware, 0)[:3]
        self.values: dict[str, Any] = dict.fromkeys(
            [field for each in self._readable.values() for field in each.fields], 0
        )
        self.values |= {
            "version_major": 1, "device_type": 1, "device_model": 1, "device_revision": 1,
            "device_id": self.facts.memory.get("device_id", self.first_id), "firmware_version_major": major,
            "firmware_version_minor": minor, "firmware_version_patch": patch, **self.at_power_on,
        }  # fmt: skip
        self.measured, self.data = self.values, b""

    def new_reader(self, client: Client) -> Reader:
        """Return the reader of a client."""
        return Decoder()

    def on_message(self, client: Client, message: Frame, now_ns: int) -> None:
        """Answer a request, or execute a command."""
        if message.destination not in (*_ANY_DEVICE, self.values["device_id"]):
            return
        self.readers[client].host = message.source
        number, payload, why = message.number, message.payload, "wrong length"
        if number in self._commands:
            why = self._command(client, number, payload, now_ns)
        elif number != GENERAL_REQUEST:  # the older form of a request: the message itself, empty
            why = "unknown message" if payload else self.send_message(number, client)
        elif len(payload) == _SUM.size:
            [number] = _SUM.unpack(payload)
            why = self.send_message(number, client)
        if why:
            self._put(client, NACK, _SUM.pack(number) + why.encode("ascii"))

    def _command(self, client: Client, number: int, payload: bytes, now_ns: int) -> str:
        layout = self._commands[number]
        fields = layout.unpack(payload)
        if fields is None:
            return "wrong length"
        for name, value in fields.items():
            low, high = self._limits.get(name, (value, value))
            if not low <= value <= high:
                return f"{name} out of range"
        if layout.name == "set_device_id":
            self.values["device_id"] = self.facts.memory["device_id"] = fields[layout.fields[0]]
        elif why := self.execute(client, layout.name, fields, now_ns):
            return why
        if layout.name not in self.answered:
            self._put(client, ACK, _SUM.pack(number))
        return ""

    def execute(self, client: Client, name: str, fields: dict[str, Any], now_ns: int) -> str:
        """Execute the command `name`; return why not, as short ASCII text, or ""."""
        self.values.update(fields)
        return ""

    def send_message(self, number: int, client: Client, measured_ns: int = 0) -> str:
        """Send a message with the present values, or those measured; return why not, or ""."""
        if number not in self._readable:
            return "unknown message"
        values = self.measured if number in self.measurements else self.values
        self._put(client, number, self._readable[number].pack(values, self.data), measured_ns)
        return ""

    def _put(self, client: Client, number: int, payload: bytes, measured_ns: int = 0) -> None:
        if client in self.readers:
            frame = Frame(number, payload, self.values["device_id"], self.readers[client].host)
            self.send(encode(frame), client, measured_ns=measured_ns)
