"""ROS 1 of Debian reads and commands a vehicle: rosmaster, rostopic, rosservice, rosparam, rosbag, rospy.

apt install python3-rosmaster python3-rostopic python3-rosservice python3-rosnode python3-rosparam python3-rosbag \
    python3-rospy python3-tf2-ros python3-std-srvs python3-{sensor,nav,diagnostic,visualization,trajectory}-msgs
"""

import json
import re
import shutil
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from ruamel.yaml import YAML

from hil.gateways.ros1.messages import kind_of
from hil.ros.topics import TOPICS
from tests.support.documents import blocks
from tests.support.processes import ROOT, Program, free_port, wait_for, write_scenario

DEBIAN = "/usr/bin/python3"
TOOLS = ("rosmaster", "rostopic", "rosservice", "rosnode", "rosparam", "rosbag")
MODULES = "rospy, rosbag, tf2_ros, std_srvs.srv, sensor_msgs, nav_msgs, diagnostic_msgs, visualization_msgs"
CAMERA = '[sensors.camera]\nrate = "2 Hz"\nwidth = 64\nheight = 48\n[ros]\nimages = "raw"\n'
PAGE = ROOT / "docs/tutorials/ros1.md"


def has_ros1() -> bool:
    try:
        imported = subprocess.run([DEBIAN, "-c", f"import {MODULES}"], capture_output=True).returncode == 0
    except OSError:
        return False
    return imported and all(shutil.which(tool, path="/usr/bin") for tool in TOOLS)


pytestmark = pytest.mark.skipif(not has_ros1(), reason="Debian's packages of ROS 1 are not installed, see above")


class Ros:
    """The programs of ROS 1, with one ROS master."""

    def __init__(self, folder: Path, uri: str) -> None:
        self.folder = folder
        self.environment = {
            "PATH": "/usr/bin:/bin", "HOME": str(folder), "ROS_MASTER_URI": uri, "ROS_IP": "127.0.0.1",
            "PYTHONUNBUFFERED": "1",
        }  # fmt: skip

    def start(self, *words: object) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [str(word) for word in words], env=self.environment, cwd=self.folder, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip

    def run(self, *command: object, seconds: float = 120.0) -> str:
        """Return the output of a program that ends well."""
        program = self.start(*command)
        try:
            output, _ = program.communicate(timeout=seconds)
        except subprocess.TimeoutExpired:
            program.kill()
            output, _ = program.communicate()
            raise AssertionError(f"{command} did not end: {output}") from None
        assert program.returncode == 0, f"{command}: {output}"
        return output

    def until(self, pattern: str, *command: object, seconds: float = 120.0) -> str:
        """Run an endless program until it has printed the pattern; return its output."""
        printed = self.folder / f"printed-{time.monotonic_ns()}"
        with printed.open("w") as file:
            program = subprocess.Popen(
                [str(word) for word in command], env=self.environment, cwd=self.folder, stdout=file,
                stderr=subprocess.STDOUT,
            )  # fmt: skip
        try:
            assert wait_for(lambda: re.search(pattern, printed.read_text()), seconds), printed.read_text()
        finally:
            program.terminate()
            program.wait(60)
        return printed.read_text()


@pytest.fixture(scope="module")
def ros(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Ros]:
    """Provide a ROS master of Debian, and a vehicle with a camera that may be commanded through it."""
    folder = tmp_path_factory.mktemp("ros1")
    path, slave_port = write_scenario(folder, top=CAMERA)
    port = free_port()
    ros = Ros(folder, f"http://127.0.0.1:{port}")
    with (
        Program(folder, "--core", "-p", port, command=["/usr/bin/rosmaster"], environment=ros.environment),
        Program(folder, "slave", path) as slave,
    ):
        slave.expect("ready")
        words = ("gateway", "ros1", "--connect", f"tcp/127.0.0.1:{slave_port}", "--command")
        with Program(folder, *words, environment={"ROS_MASTER_URI": ros.environment["ROS_MASTER_URI"]}) as gateway:
            gateway.expect("connected: uuv1")
            gateway.expect("the ROS master at .* is connected")
            yield ros
        assert not [name for name in ros.run("rostopic", "list", "-p").split() if name.startswith("/uuv1")]
        assert "Traceback" not in gateway.output


def test_md5_sums_are_those_of_debian(ros: Ros) -> None:
    kinds = [kind_of(row.type) for row in TOPICS.values() if row.type.split("/")[0] not in UNKNOWN]
    program = (
        "import json, sys; from roslib.message import get_message_class as get;"
        "print(json.dumps({name: get(name)._md5sum for name in sys.argv[1:]}))"
    )
    found = json.loads(ros.run(DEBIAN, "-c", program, *{kind.name for kind in kinds}))
    assert found == {kind.name: kind.md5sum for kind in kinds}
    assert len(found) > 25


UNKNOWN = ("marine_acoustic_msgs", "rcl_interfaces")  # Debian has them not


def test_rostopic_lists_echoes_and_measures(ros: Ros) -> None:
    assert wait_for(
        lambda: "/uuv1/cmd_vel" in (listed := ros.run("rostopic", "list")) and "/uuv1/camera" in listed, 200
    )
    listed = set(ros.run("rostopic", "list").split())
    assert {"/clock", "/tf", "/tf_static", "/uuv1/imu", "/uuv1/odom", "/uuv1/map"} <= listed
    assert ros.run("rostopic", "type", "/uuv1/imu").strip() == "sensor_msgs/Imu"
    echoed = YAML(typ="safe").load(ros.run("rostopic", "echo", "-n", "1", "/uuv1/odom").partition("---")[0])
    assert echoed["child_frame_id"] == "base_link"
    assert echoed["pose"]["pose"]["position"]["z"] < 0.0
    assert "imu_link" in ros.run("rostopic", "echo", "-n", "1", "/tf_static")
    assert "width: 64" in ros.run("rostopic", "echo", "-n", "1", "/uuv1/camera/camera_info")
    assert "length: 9216" in ros.run("rostopic", "echo", "-n", "1", "--noarr", "/uuv1/camera/image_raw")
    assert "resolution" in ros.run("rostopic", "echo", "-n", "1", "--noarr", "/uuv1/map")
    assert "<robot" in ros.run("rostopic", "echo", "-n", "1", "/uuv1/robot_description")
    ros.until(r"average rate: \d", "rostopic", "hz", "/uuv1/imu")
    assert "/uuv_hil" in ros.run("rostopic", "info", "/uuv1/imu")


def test_rosnode_lists_and_pings_the_node(ros: Ros) -> None:
    assert "/uuv_hil" in ros.run("rosnode", "list").split()
    assert "xmlrpc reply" in ros.run("rosnode", "ping", "-c", "1", "/uuv_hil")
    assert "/uuv1/imu [sensor_msgs/Imu]" in ros.run("rosnode", "info", "/uuv_hil")


def test_rostopic_pub_moves_the_vehicle(ros: Ros) -> None:
    twist = "{linear: {x: 0.5}}"
    with ProgramUntilExit(ros.start("rostopic", "pub", "-r", "10", "/uuv1/cmd_vel", "geometry_msgs/Twist", twist)):
        field = "/uuv1/ground_truth/twist/twist/linear/x"
        assert wait_for(lambda: float(ros.run("rostopic", "echo", "-n", "1", field).split()[0]) > 0.3)


class ProgramUntilExit:
    """A started program that is ended with the context."""

    def __init__(self, program: subprocess.Popen[str]) -> None:
        self._program = program

    def __enter__(self) -> None:
        return

    def __exit__(self, *_: object) -> None:
        self._program.terminate()
        self._program.communicate(timeout=60)


def test_rosservice_calls_the_services(ros: Ros) -> None:
    assert wait_for(lambda: "/uuv1/arm" in ros.run("rosservice", "list").split())
    assert ros.run("rosservice", "type", "/uuv1/arm").strip() == "std_srvs/SetBool"
    assert "success: True" in ros.run("rosservice", "call", "/uuv1/arm", "true")
    assert "success: True" in ros.run("rosservice", "call", "/uuv1/reset")
    (failing, *_) = [name for name in ros.run("rosservice", "list").split() if name.endswith("/fail")]
    assert "is off" in ros.run("rosservice", "call", failing, "true")
    assert "is repaired" in ros.run("rosservice", "call", failing, "false")


def test_rosparam_reads_and_sets_gains(ros: Ros) -> None:
    key = "/uuv1/gains/surge/p"
    assert wait_for(lambda: key in ros.run("rosparam", "list").split())
    before = float(ros.run("rosparam", "get", key))
    ros.run("rosparam", "set", key, str(before + 0.5))
    ros.run("rosparam", "set", "/uuv1/gains/heave/p", "much")
    assert wait_for(lambda: ros.run("rosparam", "get", "/uuv1/gains/heave/p").strip() != "much")
    assert float(ros.run("rosparam", "get", key)) == before + 0.5


def test_rosbag_records_the_topics(ros: Ros) -> None:
    bag = ros.folder / "dive.bag"
    ros.run("rosbag", "record", "-O", bag, "--duration", "8", "/uuv1/imu", "/uuv1/odom", "/tf_static", "/uuv1/dvl")
    info = YAML(typ="safe").load(ros.run("rosbag", "info", "--yaml", bag))
    counts = {each["topic"]: each["messages"] for each in info["topics"]}
    assert counts["/uuv1/imu"] > 50
    assert counts["/tf_static"] >= 1
    assert counts["/uuv1/dvl"] > 5


def test_a_rospy_node_reads_and_commands_the_vehicle(ros: Ros) -> None:
    shutil.copy(Path(__file__).with_name("ros1_peer.py"), ros.folder)
    results = json.loads(ros.run(DEBIAN, ros.folder / "ros1_peer.py", seconds=300).splitlines()[-1])
    assert results["accelerations"] == [pytest.approx(9.8, abs=1.0)] * 2
    assert abs(results["clock"] - time.time()) < 300
    assert results["image"] == [64, 48, "rgb8", 9216, True]
    assert results["depth"] < -1.0
    assert results["speed"] > 0.3
    assert results["armed"] == [True, "armed: commands are executed"]
    assert results["reset"]
    assert results["gain"] > 0.0
    assert "<robot" in results["urdf"]


def test_the_program_of_the_tutorial_runs(ros: Ros) -> None:
    (block,) = blocks("python", page=PAGE)
    program = ros.folder / "square.py"
    program.write_text(block.text)
    assert "Traceback" not in ros.until(r"depth +\d", DEBIAN, program)
