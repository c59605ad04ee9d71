"""Parameter files of PX4: QGroundControl's text, and BSON, which PX4 stores and reads (`param import`).

An integer is an INT32 parameter, any other number a FLOAT. Sources: QGroundControl's ParameterManager.cc; PX4's
src/lib/parameters/parameters.cpp, src/lib/tinybson.
"""

import struct
from collections.abc import Mapping
from contextlib import suppress
from math import isclose

from hil.autopilots.parameters import TOLERANCE, Parameters, number_text

MAV_INT32, MAV_REAL32 = 6, 9
BSON_DOUBLE, BSON_INT32 = 1, 16


def format_for_qgroundcontrol(parameters: Parameters) -> str:
    """Return the text of a parameter file as QGroundControl saves and loads them."""
    rows = "".join(
        f"1\t1\t{name}\t{number_text(value)}\t{MAV_INT32 if isinstance(value, int) else MAV_REAL32}\n"
        for name, value in parameters.items()
    )
    return f"# Onboard parameters for Vehicle 1\n#\n# Vehicle-Id Component-Id Name Value Type\n{rows}"


def encode_bson(parameters: Parameters) -> bytes:
    """Return the content of a BSON file with these parameters."""
    elements = b"".join(
        bytes([BSON_INT32 if isinstance(value, int) else BSON_DOUBLE]) + name.encode() + b"\0"
        + struct.pack("<i" if isinstance(value, int) else "<d", value)
        for name, value in parameters.items()
    )  # fmt: skip
    return struct.pack("<i", len(elements) + 5) + elements + b"\0"


def decode_bson(data: bytes) -> dict[str, float]:
    """Return the parameters of a BSON file; those before the first fault if it is damaged."""
    parameters: dict[str, float] = {}
    layouts = {BSON_DOUBLE: struct.Struct("<d"), BSON_INT32: struct.Struct("<i")}
    at = 4
    with suppress(IndexError, KeyError, ValueError, struct.error):  # PX4 reports it and has a second copy
        while data[at]:
            end = data.index(b"\0", at)
            layout = layouts[data[at]]
            (parameters[data[at + 1 : end].decode()],) = layout.unpack_from(data, end + 1)
            at = end + 1 + layout.size
    return parameters


def changed_since(listed: Mapping[str, float], stored: Mapping[str, float]) -> dict[str, float]:
    """Return the stored values that differ from those listed at the last start: a person has set them meanwhile."""
    return {
        name: value
        for name, value in stored.items()
        if name in listed and not isclose(value, listed[name], rel_tol=TOLERANCE, abs_tol=TOLERANCE)
    }
