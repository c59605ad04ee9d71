"""Messages that are declared as text: fields with the letters of `struct`, and where each value comes from; sentences.

The tables of a device, devices/NAME.toml, hold its messages, its registers, the limits of its settings and their values
at power on.
"""

import os
import struct
from binascii import crc_hqx
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, TypeVar

from hil.common.schema import preset_folder
from hil.common.tables import read_table
from hil.links.frame.checksums import SUMS

Of = TypeVar("Of")


def read_device(name: str) -> dict[str, Any]:
    """Return the tables of a device."""
    return read_table(os.path.join(preset_folder("hil/instruments/devices"), f"{name}.toml"))


class Message(NamedTuple):
    """The layout of a message: its fixed fields in order, little endian; data follow them if it `has_data`."""

    name: str
    layout: struct.Struct
    fields: tuple[str, ...]
    has_data: bool

    def pack(self, values: Mapping[str, Any], data: bytes = b"") -> bytes:
        """Return the payload with the fields' values, and the data if it has any."""
        return self.layout.pack(*[values[name] for name in self.fields]) + (data if self.has_data else b"")

    def unpack(self, payload: bytes) -> dict[str, Any] | None:
        """Return the fields' values by their names; None if the payload has another length."""
        if len(payload) != self.layout.size:
            return None
        return dict(zip(self.fields, self.layout.unpack(payload), strict=True))


def read_messages(table: Mapping[str, str]) -> dict[int, Message]:
    """Return layouts by their numbers from texts such as "range scan_start:I scan_length:I"."""
    found = {}
    for number, text in table.items():
        name, *words = text.split()
        pairs = [word.split(":") for word in words if word != "*"]
        layout = struct.Struct("<" + "".join(letter for _, letter in pairs))
        found[int(number)] = Message(name, layout, tuple(field for field, _ in pairs), words[-1:] == ["*"])
    return found


def pack_layout(layout: str, quantities: Mapping[str, Callable[[Of], Sequence[Any]]], of: Of) -> bytes:
    """Return a message, little endian, of parts such as "3f:rate", "B:7" (always 7) and "4x" (padding).

    `quantities` has the values of each name for what the message is `of`.
    """
    data = b""
    for part in layout.split():
        form, _, name = part.partition(":")
        values = quantities[name](of) if name in quantities else [int(name)] if name else ()
        data += struct.pack(f"<{form}", *values)
    return data


def fits(value: Any, allowed: Any) -> bool:
    """Return whether a value is "text", a "flag", one of some texts, a finite number from least to most, or a record.

    Of a record all fields are there, no others, and each fits what is allowed for it.
    """
    if isinstance(allowed, dict):
        is_record = isinstance(value, dict) and value.keys() == allowed.keys()
        return is_record and all(fits(value[name], each) for name, each in allowed.items())
    if isinstance(allowed, str):
        return isinstance(value, str if allowed == "text" else bool)
    if isinstance(allowed[0], str):
        return value in allowed
    return isinstance(value, int | float) and not isinstance(value, bool) and allowed[0] <= value <= allowed[1]


def sentence(body: str, with_crc: bool = False) -> bytes:
    """Return a line of NMEA 0183, or of VectorNav, with its checksum."""
    data = body.encode("latin-1")
    return b"$%b*%b\r\n" % (data, checksum(data, with_crc))


def checksum(data: bytes, with_crc: bool = False) -> bytes:
    """Return the exclusive or of the bytes, or their CRC-16 (CCITT from 0), in hexadecimal digits."""
    return b"%04X" % crc_hqx(data, 0) if with_crc else b"%02X" % SUMS["xor8"].of(data)
