"""An independent ROS 2 client, zenoh-ros2-sdk, lists, reads and commands the vehicle and calls its services.

python3 -m venv PEER && PEER/bin/pip install zenoh-ros2-sdk==0.1.8
UUV_HIL_ROS_PEER=PEER/bin/python pytest tests/system/ros/test_ros_peer.py
"""

import json
import os
import subprocess
from pathlib import Path
from typing import Any

import pytest

from hil.ros.topics import TOPICS, TYPE_HASHES
from tests.support.processes import Program, write_scenario

PEER = os.environ.get("UUV_HIL_ROS_PEER", "")
pytestmark = [
    pytest.mark.peer,
    pytest.mark.skipif(not PEER, reason="UUV_HIL_ROS_PEER names no Python with zenoh-ros2-sdk (pip)"),
]
SCRIPT = Path(__file__).with_name("ros_peer.py")


@pytest.fixture(scope="module")
def seen(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    folder = tmp_path_factory.mktemp("peer")
    scenario, port = write_scenario(folder)
    with Program(folder, "slave", scenario) as slave:
        slave.expect("ready")
        process = subprocess.run(
            [PEER, SCRIPT, str(port), str(folder / "definitions")], capture_output=True, text=True, timeout=300
        )
    assert process.returncode == 0, process.stderr
    found: dict[str, Any] = json.loads(process.stdout.splitlines()[-1])
    return found


def test_the_vehicle_is_listed_as_a_node_with_topics_and_types(seen: dict[str, Any]) -> None:
    usual = ("imu", "dvl", "dvl_twist", "altitude", "pressure", "odom", "ground_truth", "diagnostics", "cmd_vel")
    expected = {TOPICS[name].full_name("uuv1"): [TOPICS[name].type] for name in (*usual, "/tf", "/tf_static", "/clock")}
    assert {name: seen["topics"].get(name) for name in expected} == expected
    assert seen["imu"] == [["/", "uuv1", TYPE_HASHES["sensor_msgs/msg/Imu"], "::,10:,:,:,,"]]
    assert seen["commanded"] == [["/", "uuv1", TYPE_HASHES["geometry_msgs/msg/Twist"], "::,10:,:,:,,"]]
    assert seen["services"]["/uuv1/arm"] == ["std_srvs/srv/SetBool"]


def test_samples_of_the_vehicle_are_decoded(seen: dict[str, Any]) -> None:
    """The peer computes type hashes and decodes CDR by itself."""
    assert min(seen["received"].values()) >= 1
    assert seen["acceleration"] == pytest.approx(9.8, abs=0.6)  # a little less while it begins to sink
    assert seen["frames"] == ["imu_link", "base_link"]
    assert seen["pascal"] == pytest.approx(101_325 + 1000 * 9.8 * 2.0, rel=0.03)  # 2 m down
    assert seen["static"] == 5  # odom, the links of imu, dvl and pressure, and the log's own axes


def test_the_vehicle_follows_commands_of_the_client(seen: dict[str, Any]) -> None:
    assert seen["speed"] == pytest.approx(0.4, abs=0.1)


def test_services_of_the_vehicle_are_called(seen: dict[str, Any]) -> None:
    assert seen["disarmed"] == [True, "disarmed: the thrusters are stopped, commands are ignored"]
    assert seen["armed"] == [True, "armed: commands are executed"]


def test_a_thruster_failure_is_set_by_a_parameter(seen: dict[str, Any]) -> None:
    found = seen["parameters"]
    assert "failures.rear_left" in found["names"]
    assert len([name for name in found["names"] if name.startswith("failures.")]) == 6
    assert "gains.surge.p" in found["names"]
    (done,), ((refused, reason),) = found["set"]
    assert done == [True, ""]
    assert not refused
    assert "'of' is not one of off" in reason
    assert found["values"] == [[4, 'kind = "efficiency", efficiency = 0.5'], [0, ""]]
