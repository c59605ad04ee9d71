"""A rosbridge client in a separate environment with roslibpy and without this project.

    python rosbridge_peer.py ADDRESS

Prints one JSON object.
"""

import json
import sys
import time
from importlib import import_module
from typing import Any


def main() -> None:
    roslibpy: Any = import_module("roslibpy")
    ros = roslibpy.Ros(sys.argv[1])
    ros.run(60)
    received: dict[str, Any] = {}

    def subscribe(topic: str, kind: str) -> None:
        roslibpy.Topic(ros, topic, kind).subscribe(lambda message: received.__setitem__(topic, dict(message)))

    subscribe("/uuv1/ground_truth", "nav_msgs/Odometry")
    subscribe("/uuv1/robot_description", "std_msgs/String")
    command = roslibpy.Topic(ros, "/uuv1/cmd_vel", "geometry_msgs/Twist")
    command.advertise()
    deadline, speed = time.monotonic() + 60.0, 0.0
    while time.monotonic() < deadline and not (speed > 0.3 and "/uuv1/robot_description" in received):
        command.publish(roslibpy.Message({"linear": {"x": 0.5, "y": 0, "z": 0}, "angular": {"x": 0, "y": 0, "z": 0}}))
        time.sleep(0.05)
        speed = received.get("/uuv1/ground_truth", {}).get("twist", {}).get("twist", {}).get("linear", {}).get("x", 0.0)
    arm = roslibpy.Service(ros, "/uuv1/arm", "std_srvs/SetBool")
    gain = roslibpy.Param(ros, "/uuv1:gains.surge.p")
    before = gain.get(timeout=30)
    gain.set(before + 1.0, timeout=30)
    results = {
        "topics": ros.get_topics(),
        "type": ros.get_topic_type("/uuv1/imu"),
        "services": ros.get_services(),
        "nodes": ros.get_nodes(),
        "seconds": ros.get_time()["secs"],
        "details": ros.get_message_details("geometry_msgs/Twist"),
        "speed": speed,
        "urdf": received.get("/uuv1/robot_description", {}).get("data", ""),
        "armed": dict(arm.call(roslibpy.ServiceRequest({"data": True}), timeout=30)),
        "parameters": ros.get_params(),
        "raised": gain.get(timeout=30) - before,
    }
    print(json.dumps(results, default=dict), flush=True)
    ros.terminate()


if __name__ == "__main__":
    main()
