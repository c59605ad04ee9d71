"""Real ROS 2, with FastDDS, sees and commands vehicles through `uuv-hil gateway ros2`; and its types are ours.

python3 -m venv ROS2/jazzy && ROS2/jazzy/bin/pip install ros-jazzy-rclpy ros-jazzy-rmw-fastrtps-cpp \
    ros-jazzy-common-interfaces ros-jazzy-rosgraph-msgs eclipse-zenoh pyserial psutil       # and kilted, likewise
UUV_HIL_ROS2=ROS2 pytest tests/system/ros/test_ros2_bridge.py
"""

import json
import os
import signal
import subprocess
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from hil.recording.reader import read_messages
from hil.ros import message as ros_message
from hil.ros import types
from hil.ros.topics import TOPICS
from tests.support.processes import ROOT, Program, write_scenario

FOLDER = os.environ.get("UUV_HIL_ROS2", "")
RELEASES = [name for name in ("jazzy", "kilted") if os.path.exists(os.path.join(FOLDER, name, "bin", "python"))]
pytestmark = [
    pytest.mark.peer,
    pytest.mark.skipif(not RELEASES, reason="UUV_HIL_ROS2 names no folder with environments jazzy, kilted (pip)"),
]
NODE = Path(__file__).with_name("ros2_node.py")
EXAMPLE = ROOT / "examples/ros2/uuv_hil_ros2"
CAMERA = '[sensors.camera]\nrate = "2 Hz"\nwidth = 64\nheight = 48\n'
ABSENT = ("marine_acoustic_msgs", "simulation_interfaces", "tf2_msgs")  # without wheels
LOST = 0.05  # of the IMU's messages may come to one reader alone, on a busy machine


class Ros:
    """One release of ROS 2, with a domain of its own."""

    def __init__(self, release: str, domain: int) -> None:
        self.release = release
        self.python = os.path.join(FOLDER, release, "bin", "python")
        self.environment = {
            "ROS_DOMAIN_ID": str(domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_DISTRO": release,
        }  # fmt: skip

    def bridge(self, folder: Path, *ports: int, words: tuple[str, ...] = ("--command",)) -> Program:
        """Start a bridge to slaves; the vehicles' domain stays 0."""
        connect = [word for port in ports for word in ("--connect", f"tcp/127.0.0.1:{port}")]
        command = [self.python, "-m", "hil", "gateway", "ros2", *connect, *words]
        return Program(folder, command=command, environment=self.environment)

    def run(self, tasks: str, *arguments: object) -> dict[str, Any]:
        """Return the results of tasks of the node."""
        command = [self.python, str(NODE), tasks, *map(str, arguments)]
        environment = {**os.environ, **self.environment}
        done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=600)
        assert done.returncode == 0, done.stderr
        results: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
        return results


@pytest.fixture(scope="module", params=RELEASES)
def ros(request: pytest.FixtureRequest) -> Ros:
    return Ros(request.param, 60 + os.getpid() % 40)


@pytest.fixture(scope="module")
def seen(ros: Ros, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Return what the node saw and did, and what a recorder of ours got meanwhile."""
    folder = tmp_path_factory.mktemp(ros.release)
    scenario, port = write_scenario(folder, top=CAMERA)
    recording = folder / "recording"
    with (
        Program(folder, "slave", scenario, environment=ros.environment) as slave,
        ros.bridge(folder, port) as bridge,
    ):
        slave.expect("ready")
        bridge.expect("connected: /uuv1")
        words = ("recording", "make", "--connect", f"tcp/127.0.0.1:{port}", "-o", recording)
        with Program(folder, *words, environment=ros.environment) as recorder:
            recorder.expect("recording")
            results = ros.run("graph,echo,serve,parameters,commands")
            assert recorder.stop(signal.SIGINT) == 0
        assert bridge.stop(signal.SIGTERM) == 0
    messages = [each for each in read_messages(str(recording)) if each.type.split("/")[0] not in ABSENT]
    file = folder / "recorded.json"
    fields = [(each.type, each.data.hex(), ros_message.decode(each.type, each.data)) for each in messages]
    file.write_text(json.dumps(fields, default=list))
    results |= ros.run("recorded", file)
    return results | {"messages": messages, "output": bridge.output}


def test_types_have_the_hashes_of_that_release(ros: Ros) -> None:
    compared = 0
    for name in types.names():
        file = Path(FOLDER, ros.release, "share", f"{name}.json")
        if name.split("/")[0] not in ABSENT and file.exists():
            hashes = {each["type_name"]: each["hash_string"] for each in json.loads(file.read_text())["type_hashes"]}
            assert types.type_hash(name) == hashes[name]
            compared += 1
    assert compared > 100


def test_the_vehicle_is_a_node_with_topics_and_services(seen: dict[str, Any]) -> None:
    graph = seen["graph"]
    assert graph["nodes"][:2] == ["/looks", "/uuv1"]
    usual = ("imu", "altitude", "pressure", "odom", "ground_truth", "map", "robot_description", "/clock")
    expected = {TOPICS[name].full_name("uuv1"): TOPICS[name].type for name in usual}
    assert expected.items() <= graph["published"].items()
    assert graph["commanded"]["/uuv1/cmd_vel"] == ["geometry_msgs/msg/Twist"]
    assert not graph["commanded"].keys() & graph["published"].keys()
    assert graph["services"]["/uuv1/arm"] == ["std_srvs/srv/SetBool"]
    assert graph["qos"]["/uuv1/map"] == [["RELIABLE", "TRANSIENT_LOCAL"]]
    assert graph["qos"]["/clock"] == graph["qos"]["/uuv1/imu"] == [["RELIABLE", "VOLATILE"]]
    for package in ABSENT:
        assert f"{package} is not installed here: sudo apt install ros-" in seen["output"]


def test_every_topic_is_echoed_at_its_rate(seen: dict[str, Any]) -> None:
    rates = seen["echo"]["rates"]
    assert len(rates) == seen["echo"]["subscribed"] > 15
    for name in ("imu", "pressure", "odom", "altitude", "dvl_twist", "ground_truth", "/clock"):
        assert rates[TOPICS[name].full_name("uuv1")] == pytest.approx(TOPICS[name].rate_hz, rel=0.3)
    assert rates["/uuv1/camera/image_raw/compressed"] == pytest.approx(2.0, abs=1.0)
    assert seen["echo"]["gravity"] == pytest.approx(9.8, abs=0.5)
    assert "<robot" in seen["echo"]["urdf"]
    assert seen["echo"]["jpeg"] == "ffd8ff"


def test_no_message_is_lost(seen: dict[str, Any]) -> None:
    stamps = seen["echo"]["stamps"]
    sent = {int.from_bytes(each.data[4:8], "little") * 10**9 + int.from_bytes(each.data[8:12], "little")
            for each in seen["messages"] if each.topic == "/uuv1/imu"}  # fmt: skip
    during = {stamp for stamp in sent if stamps[0] <= stamp <= stamps[-1]}
    assert len(stamps) == len(set(stamps)) > 500
    assert len(during ^ set(stamps)) < LOST * len(stamps)


def test_every_command_moves_the_vehicle(seen: dict[str, Any]) -> None:
    topics = ("cmd_vel", "cmd_vel_stamped", "cmd_wrench", "cmd_thrusters", "cmd_pose", "cmd_depth")
    assert seen["commands"] == dict.fromkeys(topics, True)


def test_services_and_parameters_are_the_vehicles(seen: dict[str, Any]) -> None:
    assert list(seen["serve"]["fail"].values()) == [[True, True]] * 6
    assert seen["serve"]["armed"][1] == "armed: commands are executed"
    assert seen["serve"]["reset"]
    found = seen["parameters"]
    assert {"gains.surge.p", "failures.rear_left"} <= set(found["listed"])
    (done, _), (refused, reason) = found["set"]
    assert done
    assert not refused
    assert "'of' is not one of off" in reason
    assert found["change"] == pytest.approx(0.5)
    assert found["types"] == [3, 4]
    assert found["described"] == ["gains.surge.p"]
    assert found["atomically"]


def test_ros_reads_the_same_fields_in_a_recording(seen: dict[str, Any]) -> None:
    messages = seen["messages"]
    counts = {kind: sum(each.type == kind for each in messages) for kind in {each.type for each in messages}}
    assert seen["recorded"] == counts
    assert len(counts) > 10


def test_the_example_follows_its_course_and_ends_with_sigterm(ros: Ros, tmp_path: Path) -> None:
    # Keys of a vehicle for Humble have other hashes than those of the bridge's own release.
    scenario, port = write_scenario(tmp_path, top='[ros]\ndistro = "humble"\n' if ros.release == "jazzy" else "")
    environment = ros.environment | {"PYTHONPATH": str(EXAMPLE)}
    words = ("-m", "uuv_hil_ros2.follow_course", "--ros-args", "-p", "depth:=2.0", "-p", "points:=[6.0, 5.0]")
    with (
        Program(tmp_path, "slave", scenario, environment=ros.environment) as slave,
        ros.bridge(tmp_path, port) as bridge,
        Program(tmp_path, *words, command=[ros.python], environment=environment) as node,
    ):
        slave.expect("ready")
        node.expect(r"reached \(6.0, 5.0\)", 200.0)
        assert node.stop(signal.SIGTERM) == 0, node.output
        assert "Traceback" not in node.output + bridge.output


@pytest.mark.parametrize("ros", RELEASES[:1], indirect=True)
def test_of_two_bridges_one_serves_a_vehicle_and_without_the_flag_none_commands(ros: Ros, tmp_path: Path) -> None:
    ports = []
    with ExitStack() as stack:
        for node in ("uuv1", "uuv2"):
            folder = tmp_path / node
            folder.mkdir()
            scenario, port = write_scenario(folder, slave=f'node = "{node}"')
            ports.append(port)
            stack.enter_context(Program(folder, "slave", scenario, environment=ros.environment)).expect("ready")
        first = stack.enter_context(ros.bridge(tmp_path, *ports))
        first.expect("connected: /uuv1, /uuv2")
        words = ("topic", "list", "--json", "--connect", f"tcp/127.0.0.1:{ports[0]}")
        with Program(tmp_path, *words, environment=ros.environment) as listing:
            assert listing.wait() == 0
        subscribers = {each["node"] for each in json.loads(listing.output) if each["kind"] == "MS"}
        assert subscribers == {"/uuv1"}  # not the bridge, as nobody in ROS subscribes
        echo = stack.enter_context(
            Program(tmp_path, "topic", "echo", "/clock", *words[3:], environment=ros.environment)
        )
        echo.expect("clock:")  # a subscriber of a shared topic is no vehicle
        second = stack.enter_context(ros.bridge(tmp_path, ports[0], words=()))
        second.expect("/uuv1: this ROS network has that node already")
        graph = ros.run("graph")["graph"]
        assert graph["nodes"][:3] == ["/looks", "/uuv1", "/uuv2"]
        assert len(graph["qos"]["/uuv1/imu"]) == len(graph["qos"]["/uuv2/imu"]) == 1
        assert "/uuv1/cmd_vel" in graph["commanded"]
        assert len(graph["qos"]["/clock"]) == 2  # of the network of each vehicle
        assert first.stop(signal.SIGTERM) == 0
        second.expect("connected: /uuv1\n")
        graph = ros.run("graph")["graph"]
    assert graph["commanded"] == {}
    reading = {
        "describe_parameters", "get_parameter_types", "get_parameters", "get_type_description", "list_parameters",
    }  # fmt: skip
    assert {name.rpartition("/")[2] for name in graph["services"]} == reading
