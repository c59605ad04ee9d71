"""A recording converted to a ROS 1 bag as in docs/how-to/record.md is read by the ROS 1 library of Debian."""

import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.processes import Program, wait_for, write_scenario

DEBIAN = "/usr/bin/python3"  # with python3-rosbag and the packages of messages, where they are installed
READ = """
import json, sys, rosbag
counts, first = {}, {}
for topic, message, _ in rosbag.Bag(sys.argv[1]).read_messages():
    counts[topic] = counts.get(topic, 0) + 1
    first.setdefault(topic, (message._type, message._md5sum))
    if topic == "/uuv1/odom":
        depth = message.pose.pose.position.z
    if topic == "/tf_static":
        frames = [each.child_frame_id for each in message.transforms]
print(json.dumps([counts, first, depth, frames]))
"""
# As `rosmsg md5` has them.
MD5 = {
    "nav_msgs/Odometry": "cd5e73d190d741a2f92e81eda573aca7",
    "sensor_msgs/Imu": "6a62c6daae103f4ff57a132d6f95cec2",
    "tf2_msgs/TFMessage": "94810edda583a504dfda3829e70d7eec",
}


def has_rosbag() -> bool:
    try:
        return subprocess.run([DEBIAN, "-c", "import rosbag"], capture_output=True).returncode == 0
    except OSError:
        return False


@pytest.mark.skipif(not has_rosbag(), reason="Debian's python3-rosbag is not installed")
def test_ros_1_reads_a_converted_recording(tmp_path: Path) -> None:
    scenario, port = write_scenario(tmp_path)
    folder, bag = tmp_path / "dive7", tmp_path / "dive7.bag"
    with Program(tmp_path, "slave", scenario) as slave:
        slave.expect("ready")
        with Program(tmp_path, "recording", "make", "--connect", f"tcp/127.0.0.1:{port}", "-o", folder) as recorder:
            assert wait_for(lambda: sum(file.stat().st_size for file in folder.glob("*.mcap")) > 30_000)
            assert recorder.stop(signal.SIGINT) == 0
    convert = Path(sys.executable).with_name("rosbags-convert")
    command = [str(convert), "--src", str(folder), "--dst", str(bag), "--dst-typestore", "ros1_noetic"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    read = subprocess.run([DEBIAN, "-c", READ, bag], capture_output=True, text=True, timeout=120)
    assert read.returncode == 0, read.stderr
    counts, first, depth, frames = json.loads(read.stdout)
    assert {kind: md5 for kind, md5 in first.values() if kind in MD5} == MD5
    assert counts["/uuv1/imu"] > 50
    assert depth < -1.0
    assert "imu_link" in frames
