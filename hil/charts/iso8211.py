"""Records of ISO/IEC 8211, the container of S-57 charts: the file's first record says how the others read.

What of it S-57 uses (IHO S-57 edition 3.1, part 3, annex A): one descriptive record, then data records, each a
leader, a directory and its fields; subfields are text up to a unit terminator, text of a given width, or
little-endian numbers.
"""

import re
import struct
from collections.abc import Iterator
from typing import Any, NamedTuple

from hil.errors import ConfigError

Row = dict[str, Any]  # one group of subfields by label: numbers, text, or bytes for B(40)
Record = dict[str, list[Row]]  # tag -> its rows; a field that cannot repeat has one

_UNIT, _FIELD = b"\x1f", b"\x1e"  # terminators of subfields and of fields
_LEADER = 24
_SUBFIELD = re.compile(r"(\d*)(b[12][124]|[AIRB])(?:\((\d+)\))?")
_BINARY = {"b11": "B", "b12": "H", "b14": "I", "b21": "b", "b22": "h", "b24": "i"}


class Layout(NamedTuple):
    """The subfields of a field. `packed` reads a whole row at once where all of them have a fixed width."""

    labels: tuple[str, ...]
    formats: tuple[tuple[str, int], ...]  # the code as in the file, and the width in bytes: 0 up to a terminator
    packed: struct.Struct | None


def read_records(data: bytes, where: str, skip: tuple[str, ...] = ()) -> Iterator[Record]:
    """The data records of a file's bytes, without the fields named in `skip`; `where` opens every error message.

    Raises ConfigError where the bytes are not ISO 8211, end too early or do not read as described.
    """
    if len(data) < _LEADER or data[6:7] != b"L" or not data[:5].isdigit():
        raise ConfigError(f"{where}: not an ISO 8211 file, which a .000 chart is: is it packed, or a web page?")
    at, layouts = 0, None
    while at < len(data):
        try:
            fields, at = _split(data, at)
            if layouts is None:
                layouts = {tag: _layout(body) for tag, body in fields if tag not in ("0000", *skip)}
                continue
            yield _decode(fields, layouts)
        except _CutError:
            raise ConfigError(
                f"{where}: cut off: it has {len(data)} bytes and the record at byte {at} goes on; copy it again"
            ) from None
        except (ValueError, KeyError, IndexError, struct.error) as error:
            raise ConfigError(f"{where}: damaged at byte {at} ({error!r}); copy it again") from None


class _CutError(Exception):
    """The file ends inside a record."""


def _split(data: bytes, at: int) -> tuple[list[tuple[str, bytes]], int]:
    """The fields of the record at `at` as (tag, bytes with terminator), and where the next record begins."""
    if len(data) < at + _LEADER:
        raise _CutError
    length, base = int(data[at : at + 5]), int(data[at + 12 : at + 17])
    sizes, positions, tags = (int(data[at + i : at + i + 1]) for i in (20, 21, 23))
    width = tags + sizes + positions
    if len(data) < at + max(length, base):
        raise _CutError
    fields, end = [], base
    for entry in range(at + _LEADER, at + base - 1, width):
        tag = data[entry : entry + tags].decode("ascii")
        size = int(data[entry + tags : entry + tags + sizes])
        start = at + base + int(data[entry + tags + sizes : entry + width])
        fields.append((tag, data[start : start + size]))
        end = max(end, start + size - at)
    if len(data) < at + end:  # a record longer than its leader can say has the length 0 there
        raise _CutError
    return fields, at + end


def _layout(description: bytes) -> Layout:
    """Read a field of the descriptive record: controls, name, labels `*A!B`, formats `(b11,A(2))`."""
    _, labels, formats = description.rstrip(_FIELD).decode("latin-1").split("\x1f")
    parsed: list[tuple[str, int]] = []
    for count, code, width in _SUBFIELD.findall(formats):
        size = struct.calcsize(_BINARY[code]) if code in _BINARY else int(width or 0) // (8 if code == "B" else 1)
        parsed += [(code, size)] * int(count or 1)
    names = tuple(labels.lstrip("*").split("!"))
    if len(names) != len(parsed):
        raise ValueError(f"labels {labels} and formats {formats} differ in number")
    packed = None
    if all(size and code not in "AIR" for code, size in parsed):
        packed = struct.Struct("<" + "".join(_BINARY.get(code, f"{size}s") for code, size in parsed))
    return Layout(names, tuple(parsed), packed)


def _decode(fields: list[tuple[str, bytes]], layouts: dict[str, Layout]) -> Record:
    record: Record = {}
    for tag, body in fields:
        layout = layouts.get(tag)
        if layout is None:
            continue
        inside = body.removesuffix(_FIELD) if layout.packed is None else body[: len(body) - 1]
        rows = layout.packed.iter_unpack(inside) if layout.packed else _unpack(inside, layout)
        record.setdefault(tag, []).extend([dict(zip(layout.labels, row, strict=True)) for row in rows])
    return record


def _unpack(body: bytes, layout: Layout) -> Iterator[tuple[Any, ...]]:
    at = 0
    while at < len(body):
        row: list[Any] = []
        for code, width in layout.formats:
            end = at + width if width else body.index(_UNIT, at)
            row.append(_value(code, body[at:end]))
            at = end if width else end + 1
        yield tuple(row)


def _value(code: str, raw: bytes) -> Any:
    if code in _BINARY:
        return struct.unpack("<" + _BINARY[code], raw)[0]
    if code == "B":
        return raw
    text = raw.decode("latin-1").strip()
    if code == "A":
        return text
    return (int(text) if code == "I" else float(text)) if text else None
