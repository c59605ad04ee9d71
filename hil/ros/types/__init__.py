"""Message and service definitions of ROS 2 as data, one file for each package, read on first use.

A file has one block for each type: a line `=== NAME HASH`, then the definition as in ROS's .msg and .srv files, without
comments. HASH is that of REP 2016 (RIHS01), which is part of every key of the type. A file PACKAGE.later.msg has the
types that differ in the releases from Lyrical on.

Public: `definition`, `type_hash`, `names`, `description`. It must not know topics, nor encode messages.
"""

import os
from functools import cache
from typing import NamedTuple

from hil.common.errors import ConfigError
from hil.ros import dialect

_FOLDER = os.path.dirname(__file__)
_RULE = "=" * 80  # separates a type from its member types in ROS's own concatenated definitions
PRIMITIVES = {
    "bool": "?", "byte": "B", "char": "B", "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i",
    "uint32": "I", "int64": "q", "uint64": "Q", "float32": "f", "float64": "d", "string": "",
}  # fmt: skip


class Field(NamedTuple):
    """One field. `type`: a primitive or the full name of a message. `length`: of an array, 0 for a sequence, else None.

    `default` is the value of a field that is not set; `most` the limit of a bounded sequence or string, 0 without one.
    """

    name: str
    type: str
    length: int | None
    default: float = 0.0
    most: int = 0


class Definition(NamedTuple):
    """One message, or one half of a service, which has an empty `type_hash`. `text` is its definition."""

    name: str
    type_hash: str
    fields: tuple[Field, ...]
    text: str


def names() -> list[str]:
    """Return the names of all messages and services, sorted."""
    packages = [file.removesuffix(".msg") for file in os.listdir(_FOLDER) if file.endswith(".msg")]
    return sorted({name for package in packages for name in _package(package)})


def type_hash(name: str) -> str:
    """Return the hash of a message or service, "RIHS01_...". Raises ConfigError if it is unknown."""
    return _block(name)[0]


def definition(name: str) -> Definition:
    """Return the definition of a message, or of "PACKAGE/srv/NAME_Request" or "_Response". Raises ConfigError."""
    return _definition(name, dialect.release() in dialect.LATER)


@cache
def _definition(name: str, _is_later: bool) -> Definition:
    service, _, half = name.rpartition("_")
    if "/srv/" in name and half in ("Request", "Response"):
        text = _block(service)[1].split("---\n")[half == "Response"]
        return Definition(name, "", _fields(name, text), text)
    digest, text = _block(name)
    return Definition(name, digest, _fields(name, text), text)


def full_text(name: str) -> str:
    """Return the definition with those of all its member types, in the format of rosbag and MCAP ("ros2msg").

    Raises ConfigError.
    """
    parts, described, waiting = [definition(name).text], {name}, [name]
    while waiting:
        for field in definition(waiting.pop(0)).fields:
            if field.type not in PRIMITIVES and field.type not in described:
                described.add(field.type)
                waiting.append(field.type)
                parts.append(f"{_RULE}\nMSG: {field.type.replace('/msg/', '/')}\n{definition(field.type).text}")
    return "".join(parts)


def _block(name: str) -> tuple[str, str]:
    package = name.partition("/")[0]
    blocks = _package(package)
    if dialect.release() in dialect.LATER:
        blocks = blocks | _package(f"{package}.later")
    if name in blocks:
        return blocks[name]
    from hil.common.schema import nearest

    raise ConfigError(f"no message type {name!r} is known here{nearest(name, list(blocks) or names())}")


@cache
def _package(package: str) -> dict[str, tuple[str, str]]:
    """Return hash and text of each type of a package; empty for an unknown package."""
    path = os.path.join(_FOLDER, f"{package}.msg")
    if not package.removesuffix(".later").isidentifier() or not os.path.exists(path):
        return {}
    with open(path, encoding="utf-8") as file:
        blocks = file.read().split("=== ")[1:]
    by_name = {}
    for block in blocks:
        head, _, text = block.partition("\n")
        name, _, digest = head.partition(" ")
        by_name[name] = (digest, text)
    return by_name


def _fields(owner: str, text: str) -> tuple[Field, ...]:
    lines = [line.split() for line in text.splitlines() if line and "=" not in line.replace("<=", "")]
    return tuple([_field(owner, *words) for words in lines])


def _field(owner: str, kind: str, name: str, default: str = "0") -> Field:
    base, _, count = kind.removesuffix("]").partition("[")
    base, _, most = base.partition("<=")
    value = float({"true": 1, "false": 0}.get(default, default))
    if base not in PRIMITIVES:
        package, _, last = base.rpartition("/")
        base = f"{package or owner.partition('/')[0]}/msg/{last}"
    if count.startswith("<="):
        return Field(name, base, 0, value, int(count[2:]))
    return Field(name, base, int(count or 0) if kind.endswith("]") else None, value, int(most or 0))
