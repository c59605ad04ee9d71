"""Generate the C header of this project's frame from its TOML file, so that no offset is written twice.

    python tools/frame_header.py            writes firmware_stub/include/uuv_hil_frame.h
    python tools/frame_header.py --check    1 if it is not what the TOML file says

A number that depends on the number of thrusters is a macro with that argument.
"""

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent))

from hil.links.contract import MAX_THRUSTERS
from hil.links.frame.checksums import CHECK_BYTES, CRCS, crc_checksum
from hil.links.frame.layout import Field, FrameLayout, MessageLayout, type_size
from hil.links.frame.rules import load_layout

ROOT = Path(__file__).parent.parent
SOURCE = "firmware_stub/frames/uuv_hil.toml"
HEADER = "firmware_stub/include/uuv_hil_frame.h"
PREFIX = "UUV_HIL_FRAME_"


def main() -> int:
    """Write the header, or with --check report whether it is up to date; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="write nothing; 1 if the header is not up to date")
    path, text = ROOT / HEADER, header(load_layout(str(ROOT / SOURCE)))
    if not parser.parse_args().check:
        path.write_text(text, encoding="utf-8")
    elif not path.exists() or path.read_text(encoding="utf-8") != text:
        print(f"{HEADER} is not what {SOURCE} says: run python tools/frame_header.py", file=sys.stderr)
        return 1
    return 0


def header(layout: FrameLayout) -> str:
    """Return the text of the header of a plain frame whose messages have one `pwm_us` for each thruster."""
    groups = [
        _frame(layout),
        _checksum(layout),
        _message(layout, layout.command, "COMMAND"),
        _message(layout, layout.telemetry, "TELEMETRY"),
    ]
    body = "\n\n".join("\n".join(f"#define {PREFIX}{name} {value}" for name, value in group) for group in groups)
    return f"""\
/* Made by tools/frame_header.py of {SOURCE}, which explains each field. Do not edit.
 *
 * A field's own name is its offset from the first byte of the frame; _SIZE is in bytes; a flag's name is
 * its mask; n is the number of thrusters.
 */
#ifndef UUV_HIL_FRAME_H
#define UUV_HIL_FRAME_H

{body}

#endif
"""


def _frame(layout: FrameLayout) -> Iterator[tuple[str, str]]:
    yield "LITTLE_ENDIAN", str(int(layout.byte_order == "little"))
    yield "MAX_THRUSTERS", f"{MAX_THRUSTERS}u"
    yield "SYNC_SIZE", f"{len(layout.sync)}u"
    for place, byte in enumerate(layout.sync):
        yield f"SYNC_{place}", f"0x{byte:02X}u"
    offset = len(layout.sync)
    for field in layout.header:
        yield from _field(field, field.name.upper(), f"{offset}u")
        offset += type_size(field.type)
    yield "PAYLOAD", f"{offset}u"


def _checksum(layout: FrameLayout) -> Iterator[tuple[str, str]]:
    crc = CRCS[layout.checksum.type]
    digits = crc.width // 4
    yield "CRC_SIZE", f"{crc.width // 8}u"
    yield "CRC_POLYNOMIAL", f"0x{crc.polynomial:0{digits}X}u"
    yield "CRC_START_VALUE", f"0x{crc.start_value:0{digits}X}u"
    yield "CRC_REFLECTED", str(int(crc.reflected))
    yield "CRC_FINAL_XOR", f"0x{crc.final_xor:0{digits}X}u"
    yield "CRC_CHECK", f'0x{crc_checksum(crc).of(CHECK_BYTES):0{digits}X}u /* of "{CHECK_BYTES.decode()}" */'
    yield "CRC_START", f"{layout.checksum_start}u /* the first byte that it covers; the last is the one before it */"
    yield "CRC_LITTLE_ENDIAN", str(int((layout.checksum.byte_order or layout.byte_order) == "little"))


def _message(layout: FrameLayout, message: MessageLayout, name: str) -> Iterator[tuple[str, str]]:
    start = offset = layout.payload_start
    per_thruster = 0
    yield f"{name}_ID", f"0x{message.id:02X}u"
    for field in message.fields:
        own = f"{name}_{field.name.upper()}"
        yield from _field(field, own, _linear(offset, per_thruster) if per_thruster else f"{offset}u")
        for flag, bit in field.bits._asdict().items():
            if bit is not None:
                yield f"{name}_{flag.upper()}", f"0x{1 << bit:02X}u"
        if field.name == "pwm_us":
            per_thruster = type_size(field.type)
        else:
            offset += type_size(field.type)
    size = offset + CRCS[layout.checksum.type].width // 8
    yield f"{name}_PAYLOAD_SIZE(n)", _linear(offset - start, per_thruster)
    yield f"{name}_CRC(n)", _linear(offset, per_thruster)
    yield f"{name}_FRAME_SIZE(n)", _linear(size, per_thruster)
    yield f"{name}_FRAME_SIZE_MAX", f"{size + per_thruster * MAX_THRUSTERS}u"


def _field(field: Field, name: str, offset: str) -> Iterator[tuple[str, str]]:
    yield f"{name}(n)" if "(n)" in offset else name, offset
    yield f"{name}_SIZE", f"{type_size(field.type)}u" + (" /* of one */" if field.name == "pwm_us" else "")


def _linear(constant: int, per_thruster: int) -> str:
    return f"({constant}u + {per_thruster}u * (n))"


if __name__ == "__main__":
    sys.exit(main())
