"""rclpy, and the classes of messages and services, as the user's ROS has them installed."""

import json
import os
import re
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from hil.common.errors import ConfigError, MissingExtraError
from hil.ros.dialect import NO_HASH

TYPE = re.compile(r"([a-z][a-z0-9_]*)/(msg|srv)/([A-Z][A-Za-z0-9]*)")


def import_rclpy() -> Any:
    """Return rclpy. Raises MissingExtraError with the remedy, ConfigError if its middleware needs no bridge."""
    try:
        rclpy = import_module("rclpy")
        for part in ("executors", "node", "serialization"):  # which import all others
            import_module(f"rclpy.{part}")
        middleware = rclpy.get_rmw_implementation_identifier()
    except ImportError as error:
        raise MissingExtraError(
            f"rclpy, ROS 2's Python package, cannot be loaded ({error}): run `source /opt/ros/jazzy/setup.bash`, or "
            "that of your release, and install uuv-hil for the Python of that ROS"
        ) from None
    if middleware == "rmw_zenoh_cpp":
        raise ConfigError("RMW_IMPLEMENTATION: nodes with rmw_zenoh_cpp see the vehicle without a bridge; unset it")
    return rclpy


@cache
def find_class(name: str, type_hash: str) -> tuple[Any, str]:
    """Return the class of the type "sensor_msgs/msg/Imu"; or None, and why this ROS cannot have it.

    Names come from the network, so nothing is imported but packages of messages.
    """
    parts = TYPE.fullmatch(name)
    package, kind, last = parts.groups() if parts else ("", "", "")
    found = find_spec(package) if parts else None
    folders = [os.path.join(path, kind) for path in (found and found.submodule_search_locations) or ()]
    folder = next(filter(os.path.isdir, folders), None)
    if folder is None:
        release = os.environ.get("ROS_DISTRO", "DISTRO")
        return None, f"{package} is not installed here: sudo apt install ros-{release}-{package.replace('_', '-')}"
    own = _own_hash(folder, name)
    is_other = name == "sensor_msgs/msg/Range" if type_hash == NO_HASH else type_hash != own  # Humble's has no variance
    if own and is_other:
        return None, f"{name} of this ROS is another version; name its release in the scenario, [ros] distro"
    found_class = getattr(import_module(f"{package}.{kind}"), last, None)
    return found_class, "" if found_class else f"{package} of this ROS has no {name}"


def _own_hash(folder: str, name: str) -> str:
    """Return the hash of a type as ROS has it installed; "" before ROS 2 Iron, which has none."""
    prefix = os.path.normpath(os.path.join(folder, *[os.pardir] * 5))  # above lib/pythonX.Y/site-packages/PACKAGE/msg
    try:
        hashes = json.loads(Path(prefix, "share", f"{name}.json").read_bytes())["type_hashes"]
    except (OSError, ValueError, KeyError):
        return ""
    return next((str(each["hash_string"]) for each in hashes if each["type_name"] == name), "")
