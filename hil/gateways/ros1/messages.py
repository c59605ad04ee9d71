"""ROS 1 types that correspond to ROS 2 types: names, MD5 sums, definitions; and conversion of messages both ways.

Definitions of Noetic and the conversion are those of `rosbags`. A type that it does not know, such as those of
marine_acoustic_msgs, has the definition of hil.ros.types in both releases. Headers have a `seq` in ROS 1, which counts
the messages of a topic; fields that only one release has are left out, or zero.
"""

from collections.abc import Callable
from functools import cache
from hashlib import md5
from struct import pack
from typing import Any, NamedTuple

from rosbags.convert.converter import is_same_wireformat, migrate_bytes
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from hil.common.errors import ConfigError
from hil.ros import dialect
from hil.ros.types import PRIMITIVES, definition

HEADER = "std_msgs/msg/Header"
TIMES = {"builtin_interfaces/msg/Time": "time", "builtin_interfaces/msg/Duration": "duration"}  # no messages in ROS 1
ONLY_ROS2 = ("rcl_interfaces",)  # packages without a counterpart in ROS 1


class UnreadableError(Exception):
    """Bytes that are no message of their type."""


class Kind(NamedTuple):
    """One type: its name in ROS 2 and in ROS 1, and in ROS 1 its md5 sum and, of a message, its full definition."""

    type: str
    name: str
    md5sum: str
    definition: str = ""
    has_header: bool = False


@cache
def kind_of(type_name: str) -> Kind:
    """Return the type of ROS 1 for one of ROS 2, a message or a service. Raises ConfigError for one without."""
    if type_name.partition("/")[0] in ONLY_ROS2:
        raise ConfigError(f"{type_name} has no counterpart in ROS 1")
    if "/srv/" in type_name:
        halves = [_text_for_md5(f"{type_name}_{half}") for half in ("Request", "Response")]
        digest = md5("".join(halves).encode(), usedforsecurity=False).hexdigest()
        return Kind(type_name, type_name.replace("/srv/", "/"), digest)
    text, digest = _ros1(type_name).generate_msgdef(type_name, ros_version=1)
    fields = _ros1(type_name).fielddefs[type_name][1]
    has_header = bool(fields) and fields[0][1][1] == HEADER
    return Kind(type_name, type_name.replace("/msg/", "/"), digest, text, has_header)


def to_ros1(type_name: str, data: bytes, sequence: int = 0) -> bytes:
    """Return a message, CDR, as ROS 1 has it; `sequence` is the `seq` of its header. Raises UnreadableError."""
    message = bytearray(_convert(_converter(type_name, is_to_ros2=False), data))
    if "/srv/" not in type_name and kind_of(type_name).has_header:
        message[:4] = pack("<I", sequence & 0xFFFFFFFF)
    return bytes(message)


def to_cdr(type_name: str, data: bytes) -> bytes:
    """Return a message of ROS 1 as CDR. Raises UnreadableError."""
    return bytes(_convert(_converter(type_name, is_to_ros2=True), data))


def _convert(convert: Callable[[bytes], memoryview], data: bytes) -> memoryview:
    try:
        return convert(data)
    except Exception as error:  # noqa: BLE001 - bytes of others, in the code that the library makes of definitions
        raise UnreadableError(str(error)) from None


@cache
def _converter(type_name: str, is_to_ros2: bool) -> Callable[[bytes], memoryview]:
    """Return what copies the fields, or, where the releases differ, what goes through a message of each."""
    ros2, ros1 = (_with(store, type_name) for store in _stores())
    source, target = (ros1, ros2) if is_to_ros2 else (ros2, ros1)
    name = _known_as(type_name)
    if is_same_wireformat(source, target, name, name):
        return lambda data: (target.ros1_to_cdr if is_to_ros2 else source.cdr_to_ros1)(data, name)
    cache: dict[str, object] = {}
    return lambda data: migrate_bytes(
        source, target, name, name, cache, data, src_is2=not is_to_ros2, dst_is2=is_to_ros2
    )


def _known_as(type_name: str) -> str:
    """Return the library's name of a message, or of one half of a service."""
    return type_name.replace("/srv/", "/srv/msg/")


@cache
def _stores() -> tuple[Typestore, Typestore]:
    release = Stores.ROS2_HUMBLE if dialect.is_humble() else Stores.ROS2_JAZZY
    return get_typestore(release), get_typestore(Stores.ROS1_NOETIC)


def _ros1(type_name: str) -> Typestore:
    return _with(_stores()[1], type_name)


def _with(store: Typestore, type_name: str) -> Typestore:
    """Return a store with a type, and those in it, taken from our definitions where it has them not."""
    definitions: dict[str, Any] = {}
    waiting = [type_name]
    while waiting:
        name = waiting.pop()
        if _known_as(name) not in store.fielddefs and name not in definitions and name not in TIMES:
            definitions |= get_types_from_msg(definition(name).text, name)
            waiting += [field.type for field in definition(name).fields if field.type not in PRIMITIVES]
    if definitions:
        store.register(definitions)
    return store


def _text_for_md5(half: str) -> str:
    """Return the text of half a service of which ROS 1 makes the md5 sum: constants first, messages by their sums."""
    lines = [line.strip() for line in definition(half).text.splitlines() if line.strip()]
    fields = [_field_for_md5(half, line) for line in lines if "=" not in line]
    return "\n".join([line for line in lines if "=" in line] + fields)


def _field_for_md5(half: str, line: str) -> str:
    kind, name = line.split()[:2]
    base = kind.partition("[")[0]
    if base in PRIMITIVES:
        return f"{kind} {name}"
    package, _, last = base.rpartition("/")
    whole = f"{package or half.partition('/')[0]}/msg/{last}"
    if whole in TIMES:
        return f"{kind.replace(base, TIMES[whole])} {name}"
    return f"{kind_of(whole).md5sum} {name}"
