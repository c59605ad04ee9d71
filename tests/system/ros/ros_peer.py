"""A ROS 2 client in a separate environment with zenoh-ros2-sdk (ROBOTIS), without this project.

    python ros_peer.py PORT FOLDER

Types, hashes, keys and CDR are that library's; the message definitions are written into FOLDER by rosbags, as it would
fetch them from the network otherwise. Prints one JSON object.
"""

import json
import os
import sys
import threading
import time
from importlib import import_module
from typing import Any

MESSAGES = (
    "builtin_interfaces/msg/Time", "std_msgs/msg/Header", "geometry_msgs/msg/Vector3", "geometry_msgs/msg/Quaternion",
    "geometry_msgs/msg/Point", "geometry_msgs/msg/Pose", "geometry_msgs/msg/PoseWithCovariance",
    "geometry_msgs/msg/Transform", "geometry_msgs/msg/TransformStamped", "geometry_msgs/msg/Twist",
    "geometry_msgs/msg/TwistWithCovariance", "nav_msgs/msg/Odometry", "sensor_msgs/msg/FluidPressure",
    "sensor_msgs/msg/Imu", "rosgraph_msgs/msg/Clock", "tf2_msgs/msg/TFMessage", "rcl_interfaces/msg/ParameterValue",
    "rcl_interfaces/msg/Parameter", "rcl_interfaces/msg/ListParametersResult", "rcl_interfaces/msg/SetParametersResult",
)  # fmt: skip
SERVICES = {
    "std_srvs/srv/SetBool": "bool data\n---\nbool success\nstring message\n",
    "rcl_interfaces/srv/ListParameters": (
        "string[] prefixes\nuint64 depth\n---\nrcl_interfaces/ListParametersResult result\n"
    ),
    "rcl_interfaces/srv/GetParameters": "string[] names\n---\nrcl_interfaces/ParameterValue[] values\n",
    "rcl_interfaces/srv/SetParameters": (
        "rcl_interfaces/Parameter[] parameters\n---\nrcl_interfaces/SetParametersResult[] results\n"
    ),
}
RECEIVED = {
    "/uuv1/imu": "sensor_msgs/msg/Imu",
    "/uuv1/pressure": "sensor_msgs/msg/FluidPressure",
    "/uuv1/ground_truth": "nav_msgs/msg/Odometry",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/clock": "rosgraph_msgs/msg/Clock",
}
ARRAYS = {"byte": "u1", "bool": "?", "integer": "i8", "double": "f8"}  # of a ParameterValue
LATCHED = ":1:,1:,:,:,,"  # transient local, the last one


def write_definitions(folder: str) -> None:
    typesys = import_module("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
    files = {name: store.generate_msgdef(name, ros_version=2)[0].partition("=" * 80)[0] for name in MESSAGES}
    for name, text in files.items():
        _write(os.path.join(folder, f"{name}.msg"), text)
    for name, text in SERVICES.items():
        _write(os.path.join(folder, f"{name}.srv"), text)


def _write(path: str, text: str) -> None:
    os.makedirs(os.path.dirname(path), exist_ok=True)
    with open(path, "w") as file:
        file.write(text)


class Peer:
    """The peer library with the newest message of each topic."""

    def __init__(self, port: int, folder: str) -> None:
        self._sdk = import_module("zenoh_ros2_sdk")
        self._sdk.get_registry(folder)
        self._port = port
        self._sdk.ZenohSession.get_instance("127.0.0.1", port)
        self.newest: dict[str, Any] = {}
        self.counts: dict[str, int] = {}
        self._arrival = threading.Condition()
        self._references = [self._subscribe(topic, name) for topic, name in RECEIVED.items()]

    def _subscribe(self, topic: str, name: str, **options: Any) -> Any:
        return self._sdk.ROS2Subscriber(topic, name, lambda m: self._take(topic, m), router_port=self._port, **options)

    def _take(self, topic: str, message: Any) -> None:
        with self._arrival:
            self.newest[topic] = message
            self.counts[topic] = self.counts.get(topic, 0) + 1
            self._arrival.notify_all()

    def wait(self, topics: set[str], seconds: float) -> None:
        with self._arrival:
            self._arrival.wait_for(lambda: topics <= set(self.newest), seconds)

    def graph(self) -> dict[str, Any]:
        # Asked until there is something: what others have declared arrives a moment after the connection.
        topics: list[Any] = []
        deadline = time.monotonic() + 60.0
        while len(topics) < 10 and time.monotonic() < deadline:
            topics = self._sdk.get_topic_names_and_types(router_port=self._port)
        info = self._sdk.get_topic_info("/uuv1/cmd_vel", router_port=self._port, verbose=True)
        imu = self._sdk.get_topic_info("/uuv1/imu", router_port=self._port, verbose=True)
        return {
            "topics": dict(topics),
            "services": dict(self._sdk.get_service_names_and_types(router_port=self._port)),
            "commanded": [[end.node_namespace, end.node_name, end.type_hash, end.qos] for end in info.subscribers],
            "imu": [[end.node_namespace, end.node_name, end.type_hash, end.qos] for end in imu.publishers],
        }

    def late(self) -> int:
        """Return how many transforms a late subscriber to /tf_static gets."""
        self._references.append(self._subscribe("/tf_static", "tf2_msgs/msg/TFMessage", qos=LATCHED))
        self.wait({"/tf_static"}, 60.0)
        found = self.newest.get("/tf_static")
        return len(found.transforms) if found else 0

    def drive(self, seconds: float) -> float:
        """Command 0.4 m/s ahead by cmd_vel for so long, and return the true speed then."""
        publisher = self._sdk.ROS2Publisher("/uuv1/cmd_vel", "geometry_msgs/msg/Twist", router_port=self._port)
        types = self._sdk.ZenohSession.get_instance().store.types
        vector = types["geometry_msgs/msg/Vector3"]
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            publisher.publish(linear=vector(x=0.4, y=0.0, z=0.0), angular=vector(x=0.0, y=0.0, z=0.0))
            time.sleep(0.05)
        return float(self.newest["/uuv1/ground_truth"].twist.twist.linear.x)

    def arm(self, on: bool) -> list[Any]:
        response = self._client("arm", "std_srvs/srv/SetBool").call(data=on)
        return [response.success, response.message]

    def parameters(self) -> dict[str, Any]:
        """Return all names, the results of setting a valid and an invalid value, and the values read after that."""
        listed = self._client("list_parameters", "rcl_interfaces/srv/ListParameters").call(prefixes=[], depth=0)
        name = "failures.rear_left"
        done = [self._set(name, text) for text in ("kind = efficiency, efficiency = 0.5", "kind = of")]
        got = self._client("get_parameters", "rcl_interfaces/srv/GetParameters").call(names=[name, "none"])
        values = [[value.type, value.string_value] for value in got.values]
        return {"names": list(listed.result.names), "set": done, "values": values}

    def _set(self, name: str, text: str) -> list[Any]:
        client = self._client("set_parameters", "rcl_interfaces/srv/SetParameters")  # which loads its types
        types = self._sdk.ZenohSession.get_instance().store.types
        value = types["rcl_interfaces/msg/ParameterValue"](
            type=4, bool_value=False, integer_value=0, double_value=0.0, string_value=text, string_array_value=[],
            **{f"{key}_array_value": import_module("numpy").zeros(0, code) for key, code in ARRAYS.items()},
        )  # fmt: skip
        parameter = types["rcl_interfaces/msg/Parameter"](name=name, value=value)
        answer = client.call(parameters=[parameter])
        return [[result.successful, result.reason] for result in answer.results]

    def _client(self, name: str, kind: str) -> Any:
        return self._sdk.ROS2ServiceClient(f"/uuv1/{name}", kind, router_port=self._port, timeout=5.0)


def main() -> None:
    port, folder = int(sys.argv[1]), sys.argv[2]
    write_definitions(folder)
    peer = Peer(port, folder)
    peer.wait(set(RECEIVED), 60.0)
    imu, pressure = peer.newest["/uuv1/imu"], peer.newest["/uuv1/pressure"]
    results = peer.graph() | {
        "received": peer.counts,
        "acceleration": imu.linear_acceleration.z,
        "frames": [imu.header.frame_id, *[t.child_frame_id for t in peer.newest["/tf"].transforms]],
        "pascal": pressure.fluid_pressure,
        "static": peer.late(),
        "speed": peer.drive(3.0),
        "disarmed": peer.arm(False),
        "armed": peer.arm(True),
        "parameters": peer.parameters(),
    }
    print(json.dumps(results), flush=True)
    os._exit(0)  # its callbacks would keep the interpreter


if __name__ == "__main__":
    main()
