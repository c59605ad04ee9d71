"""A second independent ROS 2 implementation, pamoja-ros2, on a session with rmw_zenoh's settings.

python3 -m venv PEER && PEER/bin/pip install zenoh-ros2-sdk==0.1.8 pamoja-ros2==0.2.0
UUV_HIL_ROS_PEER=PEER/bin/python pytest tests/system/ros/test_pamoja_peer.py
"""

import json
import os
import subprocess
import time
from pathlib import Path

import pytest

from hil.client.client import VehicleClient
from hil.ros import encoders as ros
from hil.ros.topics import TYPE_HASHES
from tests.support.network.rmw import RELEASES, Release, session_settings
from tests.support.processes import Program, wait_for, write_scenario

PEER = os.environ.get("UUV_HIL_ROS_PEER", "")
pytestmark = [
    pytest.mark.peer,
    pytest.mark.skipif(not PEER, reason="UUV_HIL_ROS_PEER names no Python with pamoja-ros2 (pip)"),
]
SCRIPT = Path(__file__).with_name("pamoja_peer.py")
DRIVES_S = 4.0


@pytest.mark.parametrize("release", RELEASES)
def test_pamoja_reads_and_commands_the_vehicle(tmp_path: Path, release: Release) -> None:
    scenario, port = write_scenario(tmp_path)
    settings, hashes = tmp_path / "session.json5", tmp_path / "hashes.json"
    settings.write_text(session_settings(f"tcp/127.0.0.1:{port}", release))
    hashes.write_text(json.dumps(TYPE_HASHES))
    command = [PEER, str(SCRIPT), str(settings), str(hashes), str(DRIVES_S)]
    with Program(tmp_path, "slave", scenario) as slave:
        slave.expect("ready")
        with (
            VehicleClient(f"tcp/127.0.0.1:{port}", "uuv1", role="observer") as client,
            subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as peer,
        ):
            assert wait_for(lambda: "ground_truth" in client.latest and client.latest["ground_truth"].value.nu[0] > 0.3)
            output = peer.communicate(timeout=120)[0]
    results = json.loads(output.splitlines()[-1])
    assert results["received"] > 10
    assert results["attachment"] == 33
    assert abs(results["stamp"][0] - time.time()) < 300
    assert bytes.fromhex(results["twist"]) == ros.encode_twist((0.4, 0, 0), (0, 0, 0))
    hashed = TYPE_HASHES["geometry_msgs/msg/Twist"]
    assert results["key"] == ros.data_key(0, "/uuv1/cmd_vel", "geometry_msgs/msg/Twist", hashed)
    assert results["digest"] == hashed.removeprefix("RIHS01_")
