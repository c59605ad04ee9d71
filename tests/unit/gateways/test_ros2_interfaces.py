"""What the bridge to ROS 2 loads of the user's ROS, and what it says where something is missing."""

import importlib
import json
import os
import sys
from pathlib import Path
from types import ModuleType

import pytest

from hil.commands.gateways.ros2 import main
from hil.common.errors import ConfigError, MissingExtraError
from hil.gateways.ros2.interfaces import find_class, import_rclpy

HASH = "RIHS01_" + "ab" * 32


def test_rmw_zenoh_needs_no_bridge(monkeypatch: pytest.MonkeyPatch) -> None:
    rclpy = ModuleType("rclpy")
    vars(rclpy).update(get_rmw_implementation_identifier=lambda: "rmw_zenoh_cpp")
    monkeypatch.setitem(sys.modules, "rclpy", rclpy)
    for part in ("executors", "node", "serialization"):
        monkeypatch.setitem(sys.modules, f"rclpy.{part}", ModuleType(part))
    with pytest.raises(ConfigError, match="see the vehicle without a bridge"):
        import_rclpy()


def test_only_packages_of_messages_are_imported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DISTRO", "jazzy")
    assert find_class("tf9_msgs/msg/A", HASH) == (
        None, "tf9_msgs is not installed here: sudo apt install ros-jazzy-tf9-msgs",
    )  # fmt: skip
    for name in ("antigravity/msg/A", "os/msg/A", "../msg/A", "a.b/msg/A", "", "std_msgs/action/A"):
        assert find_class(name, HASH)[0] is None
    assert "antigravity" not in sys.modules


def test_a_type_of_another_version_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    place = tmp_path / "lib/python3/site-packages"
    package, share = place / "deep_msgs/msg", tmp_path / "share/deep_msgs/msg"
    for folder in (package, share):
        folder.mkdir(parents=True)
    (package / "__init__.py").write_text("class Depth: pass\n")
    (share / "Depth.json").write_text(
        json.dumps({"type_hashes": [{"type_name": "deep_msgs/msg/Depth", "hash_string": HASH}]})
    )
    monkeypatch.syspath_prepend(str(place))
    importlib.invalidate_caches()
    assert find_class("deep_msgs/msg/Depth", HASH)[0].__name__ == "Depth"
    assert "[ros] distro" in find_class("deep_msgs/msg/Depth", HASH[:-1] + "0")[1]
    assert find_class("deep_msgs/msg/Depth", "TypeHashNotSupported")[0]
    assert "has no deep_msgs/msg/Height" in find_class("deep_msgs/msg/Height", HASH)[1]


@pytest.mark.parametrize(
    ("before", "words", "variable", "value"),
    [
        ({}, [], "ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST"),
        ({}, ["--range", "subnet"], "ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET"),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}, [], "ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET"),
        ({"ROS_DISTRO": "humble"}, [], "ROS_LOCALHOST_ONLY", "1"),
        ({"ROS_DISTRO": "humble"}, ["--range", "subnet"], "ROS_LOCALHOST_ONLY", "0"),
    ],
)
def test_only_this_machine_finds_the_bridge_by_default(
    before: dict[str, str], words: list[str], variable: str, value: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_LOCALHOST_ONLY", "ROS_DISTRO"):
        monkeypatch.setenv(name, "")  # so that it is restored
        monkeypatch.delenv(name)
    for name, text in before.items():
        monkeypatch.setenv(name, text)
    with pytest.raises(MissingExtraError):
        main(words)
    assert os.environ[variable] == value
