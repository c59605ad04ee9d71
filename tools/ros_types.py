"""Write the message definitions in hil/ros/types, with their hashes.

    python tools/ros_types.py

Run by hand when a package is added or ROS changes one. Messages of ROS's own packages are taken from rosbags
(Ternaris, typestore of ROS 2 Jazzy). Services and the other packages stay as they are in the files, and only their
hashes are computed again. Hashes follow REP 2016 and rosidl_generator_type_description: SHA-256 of the
type's description as JSON, with the descriptions of all messages in it.
"""

import argparse
import hashlib
import importlib
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT))

from hil.ros import types  # noqa: E402 - works from a bare checkout too
from hil.ros.types import PRIMITIVES, Field, definition  # noqa: E402

FOLDER = ROOT / "hil" / "ros" / "types"
FROM_ROSBAGS = (
    "builtin_interfaces", "diagnostic_msgs", "geometry_msgs", "nav_msgs", "rcl_interfaces", "rosgraph_msgs",
    "sensor_msgs", "service_msgs", "std_msgs", "tf2_msgs", "trajectory_msgs", "visualization_msgs",
)  # fmt: skip
DEFAULTS = {("geometry_msgs/msg/Quaternion", "float64 w"): "float64 w 1"}  # which rosbags leaves out
# type_description_interfaces/msg/FieldType; of an array 48 more, of a bounded sequence 96, of another one 144.
# A char of a .msg file is a uint8 of the IDL that rosidl makes of it, and described as that.
NESTED, ARRAY, BOUNDED, SEQUENCE = 1, 48, 96, 144
TYPE_IDS = {
    "int8": 2, "uint8": 3, "int16": 4, "uint16": 5, "int32": 6, "uint32": 7, "int64": 8, "uint64": 9, "float32": 10,
    "float64": 11, "char": 3, "bool": 15, "byte": 16, "string": 17,
}  # fmt: skip
PLACEHOLDER = Field("structure_needs_at_least_one_member", "uint8", None)  # that of a message without fields

Description = dict[str, Any]


def describe(field: Field) -> Description:
    """Return one field, as rosidl describes it."""
    nested = "" if field.type in PRIMITIVES else field.type
    form = 0 if field.length is None else ARRAY if field.length else BOUNDED if field.most else SEQUENCE
    return _described(field.name, TYPE_IDS.get(field.type, NESTED) + form, field.length or field.most, nested)


def _described(name: str, type_id: int, capacity: int, nested: str) -> Description:
    kind = {"type_id": type_id, "capacity": capacity, "string_capacity": 0, "nested_type_name": nested}
    return {"name": name, "type": kind}


def message(name: str) -> Description:
    """Return a message, or one half of a service."""
    return {"type_name": name, "fields": [describe(field) for field in definition(name).fields or (PLACEHOLDER,)]}


def service(name: str) -> list[Description]:
    """Return a service, its two halves, and the event that ROS makes of a call."""
    request, response, event = f"{name}_Request", f"{name}_Response", f"{name}_Event"
    halves = [("request_message", request), ("response_message", response), ("event_message", event)]
    rows = [_described("info", NESTED, 0, "service_msgs/msg/ServiceEventInfo")]
    rows += [_described(key, NESTED + BOUNDED, 1, half) for key, half in (("request", request), ("response", response))]
    return [
        {"type_name": name, "fields": [_described(key, NESTED, 0, half) for key, half in halves]},
        message(request),
        message(response),
        {"type_name": event, "fields": rows},
    ]


def type_hash(name: str) -> str:
    """Return the RIHS01 hash of a message or service."""
    own = service(name) if "/srv/" in name else [message(name)]
    known = {part["type_name"]: part for part in own}
    waiting = list(_nested(own))
    while waiting:
        inner = waiting.pop()
        if inner not in known:
            known[inner] = message(inner)
            waiting += _nested([known[inner]])
    others = [known[inner] for inner in sorted(known) if inner != name]
    text = json.dumps({"type_description": known[name], "referenced_type_descriptions": others})
    return f"RIHS01_{hashlib.sha256(text.encode()).hexdigest()}"


def _nested(parts: list[Description]) -> Iterator[str]:
    for part in parts:
        yield from [field["type"]["nested_type_name"] for field in part["fields"] if field["type"]["nested_type_name"]]


def definitions_of_rosbags(package: str) -> dict[str, str]:
    """Return the definitions of a package's messages, by name."""
    typesys = importlib.import_module("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
    licences = {}
    for name in sorted(name for name in store.fielddefs if name.startswith(f"{package}/msg/")):
        text, _ = store.generate_msgdef(name, ros_version=2)
        own = text.partition("=" * 80)[0].strip()
        own = "\n".join(DEFAULTS.get((name, line), line) for line in own.splitlines())
        licences[name] = f"{own}\n" if own and PLACEHOLDER.name not in own else ""
    return licences


def services_here(package: str) -> dict[str, str]:
    """Return the definitions of a package's services by name."""
    return {name: text for name, (_, text) in types._package(package).items() if "/srv/" in name}


def write(package: str, definitions: dict[str, str], hashes: dict[str, str]) -> None:
    """Write the file of one package."""
    blocks = [f"=== {name} {hashes[name]}\n{text}" for name, text in definitions.items()]
    (FOLDER / f"{package}.msg").write_text("".join(blocks), encoding="utf-8")


def _forget() -> None:
    types.definition.cache_clear()
    types._package.cache_clear()


def main() -> int:
    """Write all files again: definitions first, then, as they can be read, with their hashes."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    packages = {package: definitions_of_rosbags(package) | services_here(package) for package in FROM_ROSBAGS}
    for package, definitions in packages.items():
        write(package, definitions, dict.fromkeys(definitions, "-"))
    _forget()
    for package in sorted({name.partition("/")[0] for name in types.names()}):
        definitions = {name: text for name, (_, text) in types._package(package).items()}
        hashes = {name: type_hash(name) for name in definitions}
        write(package, definitions, hashes)
        print(f"{package}: {len(definitions)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
