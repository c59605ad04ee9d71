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
from pathlib import Path

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT))

from hil.ros import dialect, types  # noqa: E402 - works from a bare checkout too
from hil.ros.types.description import PLACEHOLDER, describe_type  # noqa: E402

FOLDER = ROOT / "hil" / "ros" / "types"
FROM_ROSBAGS = (
    "builtin_interfaces", "diagnostic_msgs", "geometry_msgs", "nav_msgs", "rcl_interfaces", "rosgraph_msgs",
    "sensor_msgs", "service_msgs", "std_msgs", "tf2_msgs", "trajectory_msgs", "visualization_msgs",
)  # fmt: skip
DEFAULTS = {("geometry_msgs/msg/Quaternion", "float64 w"): "float64 w 1"}  # which rosbags leaves out


def type_hash(name: str) -> str:
    """Return the RIHS01 hash of a message or service."""
    return f"RIHS01_{hashlib.sha256(json.dumps(describe_type(name)).encode()).hexdigest()}"


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
    types._definition.cache_clear()
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
    dialect.select(0, "rolling")
    for path in FOLDER.glob("*.later.msg"):
        definitions = {name: text for name, (_, text) in types._package(path.stem).items()}
        write(path.stem, definitions, {name: type_hash(name) for name in definitions})
    return 0


if __name__ == "__main__":
    sys.exit(main())
