"""`uuv-hil link frame`: describe a frame file byte by byte, and decode bytes of a line with it."""

import argparse
import re
import sys
from collections.abc import Iterator

from hil.common.columns import aligned
from hil.common.errors import ConfigError
from hil.common.options import integer, new_parser
from hil.common.schema import find_preset, preset_names
from hil.links.contract import MAX_THRUSTERS, PWM_NEUTRAL_US, Message, ThrusterCommand, ThrusterTelemetry
from hil.links.frame.check import WRONG, Part, Row, split_bytes, table
from hil.links.frame.forms import checksum_of
from hil.links.frame.layout import ChecksumRule, FrameLayout, MessageLayout, Other
from hil.links.frame.protocol import FrameProtocol

EXAMPLES = """\
The exit code is 1 if some of the bytes are damaged, dropped, malformed or left over.

examples:
  uuv-hil link frame list
  uuv-hil link frame check aa55                                  its byte tables
  uuv-hil link frame check my_lab.toml --thrusters 8
  uuv-hil link frame check aa55 AA 55 05 10 07 01 f4 01 12       decode these bytes
  xxd -p capture.bin | uuv-hil link frame check my_lab.toml -    decode the bytes of a file
"""
FRAMES = "firmware_stub/frames"
BYTES_PER_LINE = 16
CHANNELS = integer(1, MAX_THRUSTERS)
CRC_PARAMETERS = ("polynomial", "start_value", "reflected", "final_xor")


def main(arguments: list[str]) -> int:
    """List the installed frames, describe one, or decode bytes with it; return the exit code. Raises HilError."""
    options = _parser().parse_args(arguments)
    if options.action == "list":
        print("\n".join(listing()))
        return 0
    data = read_hex(options.hex)
    protocol = FrameProtocol(find_preset(FRAMES, options.file), options.role)
    if not options.hex:
        print("\n".join(description(protocol, _channels(protocol, options))))
        return 0
    parts = split_bytes(protocol, data)
    for part in parts:
        print("\n".join(_describe_part(part)))
    wrong = sum(len(part.data) for part in parts if part.kind in WRONG)
    print(f"{len(data)} bytes, {sum(part.kind == 'message' for part in parts)} messages, {wrong} bytes wrong")
    return int(wrong > 0)


def _parser() -> argparse.ArgumentParser:
    parser = new_parser("link frame", __doc__, EXAMPLES)
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION")
    actions.add_parser("list", help="list the frames")
    check = actions.add_parser("check", help="describe a frame file, or decode bytes with it")
    check.add_argument("file", metavar="NAME|FILE", help="an installed frame, or a .toml file")
    check.add_argument(
        "hex", metavar="HEX", nargs="*", help="bytes, with or without spaces, commas and 0x; - reads the standard input"
    )
    check.add_argument(
        "--thrusters", metavar="N", type=CHANNELS, help="number of thrusters [6, or what the frame carries]"
    )
    check.add_argument("--role", choices=["host", "device"], help="decode only what this end receives [both]")
    return parser


def listing() -> list[str]:
    """Return one line a frame: bytes of command and telemetry for six thrusters, checksum, stuffing."""
    rows = [["frame", "command", "telemetry", "checksum", "stuffing"]]
    for name in preset_names(FRAMES):
        protocol = FrameProtocol(find_preset(FRAMES, name))
        channels = 6 if 6 in protocol.channels else protocol.channels[0]
        sizes = [f"{_size(protocol, kind, channels)} B" for kind in (ThrusterCommand, ThrusterTelemetry)]
        rows.append([name, *sizes, protocol.layout.checksum.type, protocol.layout.stuffing.type])
    return aligned(rows)


def description(protocol: FrameProtocol, channels: int) -> Iterator[str]:
    """Yield the byte tables of a frame for `channels` thrusters."""
    layout = protocol.layout
    yield f"{channels} thruster{'s' * (channels > 1)}, {layout.byte_order}-endian; {_checksum(layout.checksum, layout)}"
    if layout.stuffing.type != "none":
        yield f"stuffing: {layout.stuffing.type}; offsets before it, sizes on the line with neutral pulses"
    for name, message in (("command", layout.command), ("telemetry", layout.telemetry)):
        yield ""
        yield from _message(name, layout, message, channels)
    for other in layout.other:
        yield ""
        yield from _message(f"{other.name}, {_sender(other)}", layout, other, channels)


def read_hex(words: list[str]) -> bytes:
    """Return the bytes of a hex dump; "-" reads it from standard input. Raises ConfigError that names an error."""
    text = sys.stdin.read() if words == ["-"] else " ".join(words)
    data = b""
    for word in re.split(r"[\s,;:]+|\\x|0[xX]", text):
        digits = word.zfill(2) if len(word) == 1 else word
        try:
            data += bytes.fromhex(digits)
        except ValueError:
            raise ConfigError(f"HEX: {word!r} is not hexadecimal: give pairs of 0-9 and a-f") from None
    return data


def _channels(protocol: FrameProtocol, options: argparse.Namespace) -> int:
    count: int = options.thrusters or (6 if 6 in protocol.channels else protocol.channels[0])
    if count not in protocol.channels:
        carried = " to ".join(map(str, sorted({protocol.channels[0], protocol.channels[-1]})))
        raise ConfigError(f"--thrusters: this frame carries {carried} thrusters, not {count}")
    return count


def _size(protocol: FrameProtocol, kind: type[Message], channels: int) -> int:
    """Return the number of bytes on the wire of a message with neutral pulses."""
    pulses = (PWM_NEUTRAL_US,) * channels
    if kind is ThrusterCommand:
        return len(protocol.encode(ThrusterCommand(1, True, pulses)))
    return len(protocol.encode(ThrusterTelemetry(1, True, False, pulses, 1, 1, 1, 1)))


def _checksum(rule: ChecksumRule, layout: FrameLayout) -> str:
    order = {"little": "low", "big": "high"}[rule.byte_order or layout.byte_order]
    own = [f"{name} 0x{value:X}" for name in CRC_PARAMETERS if (value := getattr(rule, name)) is not None]
    words = f"{' '.join([rule.type, *own])} from byte {layout.checksum_start} up to itself"
    words += f" less {rule.omit_last}" if rule.omit_last else ""
    return words if checksum_of(rule).size == 1 else f"{words}, {order} byte first"


def _sender(other: Other) -> str:
    sender = {"host": "from the host", "device": "from the STM32", "both": "from both"}[other.sent_by]
    if not other.period:
        return f"{sender}, ignored"
    return (
        f"{sender} {'after' if other.when_silent else 'every'} {other.period * 1e3:g} ms"
        + " of silence" * other.when_silent
    )


def _message(name: str, layout: FrameLayout, message: MessageLayout | Other, channels: int) -> Iterator[str]:
    rows = table(layout, message, channels)
    last = rows[-1]
    yield f"{name}, {last.offset + int(last.type[1:]) // 8} bytes"
    cells = [["offset", "type", "field", "meaning"]]
    for row in rows:
        kind = row.type if row.numbers == 1 else f"{row.type}[{row.numbers}]"
        cells.append([str(row.offset), kind, row.name, _meaning(row)])
    yield from aligned(cells, indent="  ")


def _meaning(row: Row) -> str:
    field = row.field
    if row.value is not None:
        return f"0x{row.value:02X}" + (f" = {row.value}" if field and row.name != "id" else "")
    if field is None:
        return ""
    texts = [f"bit {bit} {name}" for name, bit in field.bits._asdict().items() if bit is not None]
    if field.name in ("pwm_us", "age_us") or field.extra:
        texts.append(_quantity(row))
    if field.full_scale or field.unit == "normalised":
        texts.append(f"1900 us is {field.full_scale or 1:g} {field.unit}")
    return ", ".join(texts)


def _quantity(row: Row) -> str:
    field = row.field
    assert field
    unit = field.unit or ("us" if field.name in ("pwm_us", "age_us") else "")
    scale = "" if field.scale == 1.0 else f"{field.scale:g} "
    return f"{scale}{unit}" + (f" {field.offset:+g}" if field.offset else "") + ", ignored" * field.extra


def _describe_part(part: Part) -> Iterator[str]:
    text = part.text if part.kind in ("message", "other", "delimiter") else f"{part.kind}: {part.text}"
    yield f"{part.start:6}  {text}"
    if part.message:
        for name, value in part.message._asdict().items():
            yield f"        {name:15} {' '.join(map(str, value)) if name == 'pwm_us' else value}"
    elif part.kind in WRONG:
        yield from (
            f"        {part.data[i : i + BYTES_PER_LINE].hex(' ')}" for i in range(0, len(part.data), BYTES_PER_LINE)
        )
