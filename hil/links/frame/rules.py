"""Validation of a frame file: each finding names the key and the remedy."""

from collections.abc import Iterator

from hil.common.errors import ConfigError
from hil.common.schema import load
from hil.links.contract import MAX_THRUSTERS
from hil.links.frame.checksums import CRCS, SUMS
from hil.links.frame.layout import UNITS, ChecksumRule, Field, FrameLayout, Stuffing, fields_size, limits, type_size

COMMON = ("sequence", "flags", "count", "length", "pad", "pwm_us")
REPORTED = ("age_us", "frames", "errors", "watchdog_trips")
KNOWN = {
    "header": ("id", *COMMON[:-1]),
    "command": COMMON,
    "telemetry": (*COMMON, *REPORTED),
    "other": ("length", "count", "pad"),
}


def load_layout(path: str) -> FrameLayout:
    """Return the frame file at `path` as a record. Raises ConfigError naming the file, the key and the remedy."""
    layout = load(path, FrameLayout)
    problem = next(_list_faults(layout), None)
    if problem:
        raise ConfigError(f"{path}: {problem}")
    return layout


def _list_faults(layout: FrameLayout) -> Iterator[str]:
    if not layout.sync and layout.stuffing.type == "none":
        yield "sync: needs at least one byte, as there is no stuffing that delimits the frames"
    yield from _fields(layout.header, "header", layout.header)
    for name, message in (("command", layout.command), ("telemetry", layout.telemetry)):
        yield from _fields(message.fields, name, layout.header)
        if not any(field.name == "pwm_us" for field in message.fields):
            yield f"{name}: has no pwm_us: say where its thrusters stand"
    for number, other in enumerate(layout.other):
        yield from _fields(other.fields, f"other[{number}]", layout.header)
    yield from _ids(layout)
    yield from _lengths(layout)
    yield from _checksum(layout.checksum, [field.name for field in layout.header])
    yield from _stuffing(layout.stuffing)


def _fields(fields: tuple[Field, ...], where: str, header: tuple[Field, ...]) -> Iterator[str]:
    known = KNOWN[where.partition("[")[0]]
    names = [field.name for field in fields]
    taken = names if where == "header" else [*names, *(field.name for field in header)]
    for field in fields:
        own = field.name not in (*KNOWN["telemetry"], "id")
        if field.name not in known and not (own and (field.extra or field.value is not None)):
            remedy = "; a name of your own needs `value` (a constant) or `extra = true`" if own else ""
            yield f"{where}: {field.name!r} cannot be in it; there are: {', '.join(known)}{remedy}"
        if field.name != "pad" and taken.count(field.name) > 1:
            yield f"{where}: {field.name!r} stands there twice"
        for problem in _field(field, own, where in ("command", "telemetry")):
            yield f"{where}: {problem}"


def _field(field: Field, own: bool, in_message: bool) -> Iterator[str]:
    name = field.name
    bits = [bit for bit in field.bits if bit is not None]
    low, high = limits(field.type)
    width = 8 * type_size(field.type)
    measured = field.extra or name in ("pwm_us", "age_us")
    if bits and (name != "flags" or max(bits) >= width):
        yield f"{name} of type {field.type} cannot have these bits"
    if field.channels and name != "pwm_us":
        yield f"only pwm_us has channels, {name!r} has not"
    if field.per_channel and not (field.extra and in_message):
        yield f"per_channel is for extra fields of command and telemetry, {name!r} is none"
    if field.adds and name not in ("length", "count"):
        yield f"adds is for length and count, not for {name!r}"
    if field.type == "f32" and not measured:
        yield f"{name} cannot be f32: it is a whole number; give it u8 to i32"
    if field.value is not None and not own:
        yield f"{name} cannot have a value of its own"
    if field.value is not None and not low <= field.value <= high:
        yield f"{name}: {field.value} does not fit in {field.type}"
    yield from _scaling(field, measured)


def _scaling(field: Field, measured: bool) -> Iterator[str]:
    name = field.name
    if not measured and (field.scale, field.offset) != (1.0, 0.0):
        yield f"{name} cannot have scale or offset: it is a plain number"
    if field.scale == 0.0:
        yield f"{name}: scale 0 would make all numbers one; leave it out for 1"
    if name == "pwm_us" and field.unit not in ("", *UNITS):
        yield f"pwm_us: unit {field.unit!r} is not one of {', '.join(UNITS)}"
    elif field.unit and name != "pwm_us" and not field.extra:
        yield f"{name}: unit is for pwm_us and extra fields"
    converted = name == "pwm_us" and field.unit in UNITS[1:]
    if field.full_scale is not None and not converted:
        yield f"{name}: full_scale is for pwm_us whose unit is normalised, rpm or N"
    if converted and field.unit != "normalised" and field.full_scale is None:
        yield f"pwm_us: unit {field.unit} needs full_scale, what 1900 us stands for in {field.unit}"


def _ids(layout: FrameLayout) -> Iterator[str]:
    field = next((field for field in layout.header if field.name == "id"), None)
    messages = [("command", "host", layout.command.id), ("telemetry", "device", layout.telemetry.id)]
    messages += [(f"other[{number}]", other.sent_by, other.id) for number, other in enumerate(layout.other)]
    for index, (name, sender, own) in enumerate(messages):
        if (own is None) != (field is None):
            has = "an id, but the header has no 'id'" if field is None else "no id, but the header has an 'id'"
            yield f"{name}: has {has}: give both or none"
        if own is None or field is None:
            continue
        if own > limits(field.type)[1]:
            yield f"header: id must hold {own}, which {field.type} cannot"
        for other, its_sender, its_own in messages[:index]:
            # A request and its answer may share an id: the receiver's role distinguishes them.
            if own == its_own and (name == "telemetry" or sender == its_sender or "both" in (sender, its_sender)):
                yield f"{other} and {name} have the same id"


def _lengths(layout: FrameLayout) -> Iterator[str]:
    """Yield an error for each length or count whose type cannot hold its values."""
    for fields in (layout.command.fields, layout.telemetry.fields, *(other.fields for other in layout.other)):
        only = next((field.channels for field in fields if field.channels), 0)
        for channels in (only or 1, only or MAX_THRUSTERS):
            sizes = [(field, fields_size(fields, channels), "header") for field in layout.header]
            sizes += [(f, fields_size(fields[place + 1 :], channels), "fields") for place, f in enumerate(fields)]
            for field, size, where in sizes:
                needed = (size if field.name == "length" else channels) + field.adds
                low, high = limits(field.type)
                if field.name in ("length", "count") and not low <= needed <= high:
                    yield f"{where}: {field.name} must hold {needed}, which {field.type} cannot"


def _checksum(rule: ChecksumRule, header: list[str]) -> Iterator[str]:
    names = (*CRCS, *SUMS)
    own = (rule.polynomial, rule.start_value, rule.final_xor)
    if rule.type not in names:
        yield f"checksum: type: {rule.type!r} is not one of {', '.join(names)}"
        return
    if rule.type in SUMS and (rule.reflected is not None or any(value is not None for value in own)):
        yield f"checksum: {rule.type} has no polynomial, start_value, reflected or final_xor: leave them out"
    if rule.type in CRCS and any(value is not None and value >> CRCS[rule.type].width for value in own):
        yield f"checksum: its parameters must fit in the {CRCS[rule.type].width} bits of {rule.type}"
    starts = ("sync", "header", "payload", *header)
    if rule.start not in starts:
        yield f"checksum: start: {rule.start!r} is not one of {', '.join(starts)}"


def _stuffing(stuffing: Stuffing) -> Iterator[str]:
    if stuffing.type != "hdlc" and stuffing[2:] != Stuffing()[2:]:
        yield f"stuffing: delimiter, escape, xor and also are for hdlc; {stuffing.type} has its own"
    escaped = {stuffing.delimiter, stuffing.escape, *stuffing.also}
    if stuffing.type == "hdlc" and stuffing.delimiter == stuffing.escape:
        yield "stuffing: delimiter and escape must differ"
    if stuffing.type == "hdlc" and any(byte ^ stuffing.xor in escaped for byte in escaped):
        yield f"stuffing: xor 0x{stuffing.xor:02X} makes one escaped byte of another; take another xor"
