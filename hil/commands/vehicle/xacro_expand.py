"""Convert xacro to URDF in a process of its own; `$(find PACKAGE)` works without ROS."""

import re
from collections.abc import Iterable

from hil.charts import limited
from hil.common.errors import ConfigError
from hil.common.tables import read_bytes
from hil.common.text import clean

LIMITS = limited.Limits(memory=2 << 30, processor=20, seconds=60.0)
_MAX_MACROS = 4  # of a file that are named


def is_xacro(path: str) -> bool:
    """True if the file at `path` uses xacro's namespace or is named for it; also False if it cannot be read."""
    try:
        return b"/wiki/xacro" in read_bytes(path) or path.endswith(".xacro")
    except ConfigError:
        return False


def expand(path: str, arguments: Iterable[str] = ()) -> bytes:
    """Return the URDF that the xacro file at `path` makes; `arguments` are NAME=VALUE or, as in ROS, NAME:=VALUE.

    `$(find PACKAGE)` is found as sim/vehicle/urdf/ros_packages.py says. Raises ConfigError, MissingExtraError.
    """
    function, pairs = "hil.commands.vehicle.xacro_process:convert", list(map(_pair, arguments))
    try:
        text: bytes = limited.call(function, path, pairs, limits=LIMITS)
    except limited.EndedError:
        raise ConfigError(f"{path}: cannot be expanded: one of its expressions takes too long") from None
    if b"<link" not in text and (macros := _macros(path)):
        raise ConfigError(
            f"{path}: only defines macros, which another file calls: import that file, or write one that includes this "
            f"one and calls {' or '.join(macros)}"
        )
    return text


def _macros(path: str) -> list[str]:
    """Return the calls of the first macros that a file defines, each with the parameters that have no default."""
    calls = []
    for values in _tags(path, "macro")[:_MAX_MACROS]:
        needed = [word for word in values.get("params", "").split() if "=" not in word]
        calls.append(f"<xacro:{clean(' '.join([values.get('name', ''), *needed]))}/>")
    return calls


def hint(path: str) -> str:
    """Return a text that names the arguments of a xacro file, "" if it has none: they may select parts of a model."""
    given = [clean(f"{each.get('name', '')}={each.get('default', '')}") for each in _tags(path, "arg")]
    return f"; or try its arguments by --xacro: {', '.join(given)}" if given else ""


def _tags(path: str, tag: str) -> list[dict[str, str]]:
    """Return the attributes of each of xacro's elements `tag` in a file."""
    found = re.findall(rf"<xacro:{tag}\b([^>]*)>", read_bytes(path).decode("utf-8", "replace"))
    return [dict(re.findall(r"""(\w+)\s*=\s*["']([^"']*)["']""", attributes)) for attributes in found]


def _pair(argument: str) -> str:
    name, sign, value = re.split(r"(:?=)", argument, maxsplit=1) if "=" in argument else (argument, "", "")
    if not (name and sign):
        raise ConfigError(f"xacro argument {argument!r}: write NAME=VALUE")
    return f"{name}:={value}"
