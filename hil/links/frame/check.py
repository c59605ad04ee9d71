"""Explain a frame file and captured bytes to a person: the meaning of each byte, and which byte is wrong."""

from collections.abc import Iterator
from typing import NamedTuple

from hil.links.contract import Message
from hil.links.frame.bodies import numbers_of
from hil.links.frame.forms import Form, checksum_of
from hil.links.frame.layout import Field, FrameLayout, MessageLayout, Other, type_size
from hil.links.frame.protocol import FrameProtocol
from hil.links.frame.readers import Reader, SyncReader


class Row(NamedTuple):
    """`numbers` numbers of one field from `offset` on (before stuffing); `value` if they are constant."""

    offset: int
    type: str
    numbers: int
    name: str
    field: Field | None  # None: part of the frame, not of the message
    value: int | None


class Part(NamedTuple):
    """A run of bytes and what it is: `kind` is "message", "other" or "delimiter", or one of `WRONG`."""

    start: int
    data: bytes
    kind: str
    text: str
    message: Message | None = None


CUT = "a frame cut short, or of a message that is not known"
WRONG = ("damaged", "dropped", "malformed", "unfinished")


def table(layout: FrameLayout, message: MessageLayout | Other, channels: int) -> list[Row]:
    """Return the byte table of a message for this number of thrusters; interleaved lists have a row for each number."""
    rows = [Row(place, "u8", 1, "sync", None, byte) for place, byte in enumerate(layout.sync)]
    offset = len(rows)
    alternate = isinstance(message, MessageLayout) and message.interleaved
    for field, channel, value in numbers_of(layout, message, channels):
        if rows and rows[-1].field is field and field.is_list:
            rows[-1] = rows[-1]._replace(numbers=rows[-1].numbers + 1)
        else:
            name = f"{field.name}[{channel}]" if alternate and field.is_list else field.name
            rows.append(Row(offset, field.type, 1, name, field, value))
        offset += type_size(field.type)
    size = checksum_of(layout.checksum).size
    rows.append(Row(offset, f"u{8 * size}", 1, layout.checksum.type, None, None))
    rows += [Row(offset + size + place, "u8", 1, "tail", None, byte) for place, byte in enumerate(layout.tail)]
    return rows


def split_bytes(protocol: FrameProtocol, data: bytes) -> list[Part]:
    """Return `data` as `protocol` decodes it, part by part; every byte is in one part."""
    parts: list[Part] = []
    for part in _split(protocol, data):
        if parts and part.kind == parts[-1].kind == "dropped" and part.text == parts[-1].text:
            parts[-1] = parts[-1]._replace(data=parts[-1].data + part.data)
        else:
            parts.append(part)
    return parts


def _split(protocol: FrameProtocol, data: bytes) -> Iterator[Part]:
    reader, counters = protocol.reader, protocol.counters
    used = 0
    for end in range(1, len(data) + 1):
        before = counters.dropped_bytes, counters.malformed
        messages = reader.feed(data[end - 1 : end])
        dropped, malformed = counters.dropped_bytes - before[0], counters.malformed - before[1]
        if dropped:
            yield from _lost(reader, data, used, used + dropped)
            used += dropped
        if end - len(reader.unfinished) > used:
            yield _received(reader, used, data[used : end - len(reader.unfinished)], messages, malformed > 0)
            used = end - len(reader.unfinished)
    if used < len(data):
        yield Part(used, data[used:], "unfinished", "the beginning of a frame whose end is not there")


def _received(reader: Reader, start: int, data: bytes, messages: list[Message], malformed: bool) -> Part:
    frame = reader.unwrapped(data)
    if not frame:
        return Part(start, data, "delimiter", "delimiter")
    form = reader.form_of(frame)
    if malformed:
        why = f"is no {form.name}: it contradicts itself" if form else "its message is not known"
        return Part(start, data, "malformed", f"sound, but {why}")
    if not form or not messages:
        return Part(start, data, "other", form.name if form else "other")
    return Part(start, data, "message", " ".join([form.name, *_extras(form, frame)]), messages[-1])


def _extras(form: Form, frame: bytes) -> Iterator[str]:
    """Yield the extra fields of a message as text."""
    for field, number in zip(form.body.fields, form.body.packer.unpack_from(frame, len(form.prefix)), strict=True):
        if field.extra:
            yield f"{field.name}={number * field.scale + field.offset:.6g}" + (f" {field.unit}" if field.unit else "")


def _lost(reader: Reader, data: bytes, start: int, end: int) -> Iterator[Part]:
    """Yield the dropped bytes as parts: damaged frames, and bytes outside of frames."""
    if not isinstance(reader, SyncReader):
        frame = reader.unwrapped(data[start:end])
        form = reader.form_of(frame) if frame else None
        if frame and form:
            yield Part(start, data[start:end], "damaged", damage(reader, form, frame))
        else:
            yield Part(start, data[start:end], "dropped", "no frame of a size there is, or its stuffing is damaged")
        return
    offset = start
    while offset < end:
        form, size = reader.frame_at(data, offset) if data.startswith(reader.sync, offset) else (None, 0)
        is_cut = offset + size > (end if _is_sound_at(reader, data, end) else len(data))
        if form and not is_cut:
            last = min(offset + size, end)
            yield Part(offset, data[offset:last], "damaged", damage(reader, form, data[offset : offset + size]))
            offset = last
            continue
        last = data.find(reader.sync, offset + 1, end)
        last = end if last < 0 else last
        yield Part(offset, data[offset:last], "dropped", CUT if size else "no frame")
        offset = last


def _is_sound_at(reader: SyncReader, data: bytes, offset: int) -> bool:
    _, size = reader.frame_at(data, offset) if data.startswith(reader.sync, offset) else (None, 0)
    return 0 < size <= len(data) - offset and reader.trailer.is_sound(data, offset, size)


def damage(reader: Reader, form: Form, frame: bytes) -> str:
    """Return what is wrong with a frame whose checksum does not match, and the wrong byte if only one explains it."""
    trailer = reader.trailer
    end = len(frame) - trailer.size
    digits = 2 * trailer.stored.size
    stored = trailer.stored.unpack_from(frame, end)[0]
    computed = trailer.update(frame[trailer.start : end - trailer.omit_last], trailer.empty)
    text = f"{form.name}: checksum 0x{stored:0{digits}X}, its bytes give 0x{computed:0{digits}X}"
    suspects = list(_suspects(reader, frame))
    if len(suspects) != 1:
        return text
    place, value = suspects[0]
    return f"{text}; right if byte {place} ({_name_at(form, place)}) were 0x{value:02X}, not 0x{frame[place]:02X}"


def _suspects(reader: Reader, frame: bytes) -> Iterator[tuple[int, int]]:
    """Yield each byte that alone, with another value, would make the checksum match: its index and that value."""
    trial = bytearray(frame)
    for offset, own in enumerate(frame):
        for value in range(256):
            trial[offset] = value
            if value != own and reader.trailer.is_sound(bytes(trial), 0, len(trial)):
                yield offset, value
        trial[offset] = own


def _name_at(form: Form, position: int) -> str:
    offset = len(form.prefix)
    if position < offset:
        return "sync or header"
    for field in form.body.fields:
        offset += type_size(field.type)
        if position < offset:
            return field.name
    return "checksum"
