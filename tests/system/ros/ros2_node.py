# mypy: disable-error-code="import-not-found"
"""A node of a real ROS 2, in an environment without this project: it looks, echoes, calls and commands.

    python ros2_node.py TASKS RECORDED.json

Prints a line of JSON with a result for each word of TASKS, which are functions here.
"""

import json
import sys
import time
from importlib import import_module
from pathlib import Path
from typing import Any

import rclpy
from geometry_msgs.msg import PoseStamped, Twist, TwistStamped, WrenchStamped
from nav_msgs.msg import Odometry
from rclpy.node import NodeNameNonExistentError
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import Imu
from std_msgs.msg import Float64, Float64MultiArray
from std_srvs.srv import SetBool, Trigger

PATIENCE_S = 120.0
SECONDS = 6.0  # of echoing, once every topic has come
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def wait(node: Any, condition: Any, seconds: float = PATIENCE_S) -> Any:
    """Spin until the condition is true; return its last value."""
    deadline = time.monotonic() + seconds
    while not (value := condition()) and time.monotonic() < deadline:
        rclpy.spin_once(node, timeout_sec=0.05)
    return value


def names(node: Any) -> list[str]:
    return sorted(f"{space.rstrip('/')}/{name}" for name, space in node.get_node_names_and_namespaces())


def published(node: Any) -> dict[str, str]:
    """Return the topics that somebody publishes, with their types."""
    return {name: types[0] for name, types in node.get_topic_names_and_types() if node.count_publishers(name)}


def graph(node: Any) -> dict[str, Any]:
    """Return what a user sees of the vehicle."""
    wait(node, lambda: "/uuv1" in names(node) and "/uuv1/imu" in published(node))
    wait(node, lambda: "/uuv1/list_parameters" in services(node))
    wait(node, lambda: False, 1.0)  # what else there is was offered at the same time
    offered = {name: node.get_publishers_info_by_topic(name) for name in published(node)}
    return {
        "nodes": names(node),
        "published": published(node),
        "commanded": dict(node.get_subscriber_names_and_types_by_node("uuv1", "/")),
        "services": services(node),
        "qos": {
            name: [(each.qos_profile.reliability.name, each.qos_profile.durability.name) for each in infos]
            for name, infos in offered.items()
        },
    }


def services(node: Any) -> dict[str, list[str]]:
    try:
        return dict(node.get_service_names_and_types_by_node("uuv1", "/"))
    except NodeNameNonExistentError:  # it has left, as where another bridge takes over
        return {}


def load(name: str) -> Any:
    package, kind, last = name.split("/")
    return getattr(import_module(f"{package}.{kind}"), last)


def echo(node: Any) -> dict[str, Any]:
    """Return of each topic how many messages came and in how long; of the IMU also its stamps."""
    wait(node, lambda: "/uuv1/imu" in published(node))
    came: dict[str, list[float]] = {}
    newest: dict[str, Any] = {}
    stamps: list[int] = []

    def take(topic: str, message: Any) -> None:
        came.setdefault(topic, []).append(time.monotonic())
        newest[topic] = message
        if isinstance(message, Imu):
            stamps.append(message.header.stamp.sec * 10**9 + message.header.stamp.nanosec)

    subscriptions = []
    for topic, kind in published(node).items():
        if topic in ("/rosout", "/parameter_events") or topic.startswith("/uuv_hil"):
            continue
        latched = [each.qos_profile.durability for each in node.get_publishers_info_by_topic(topic)]
        profile = LATCHED if DurabilityPolicy.TRANSIENT_LOCAL in latched else QoSProfile(depth=1000)
        subscriptions.append(
            node.create_subscription(load(kind), topic, lambda m, topic=topic: take(topic, m), profile)
        )
    wait(node, lambda: len(came) == len(subscriptions))
    began = time.monotonic()
    wait(node, lambda: False, SECONDS)
    seconds = time.monotonic() - began
    for subscription in subscriptions:
        node.destroy_subscription(subscription)
    return {
        "subscribed": len(subscriptions),
        "rates": {topic: sum(t >= began for t in times) / seconds for topic, times in came.items()},
        "stamps": stamps,
        "gravity": newest["/uuv1/imu"].linear_acceleration.z,
        "urdf": newest["/uuv1/robot_description"].data[:500],
        "jpeg": bytes(newest["/uuv1/camera/image_raw/compressed"].data[:3]).hex(),
    }


def commands(node: Any) -> dict[str, Any]:
    """Command by each topic, until the vehicle does what it says."""
    state: list[Any] = []
    node.create_subscription(Odometry, "/uuv1/ground_truth", state.append, 10)

    def drive(topic: str, message: Any, condition: Any) -> bool:
        publisher = node.create_publisher(type(message), f"/uuv1/{topic}", 10)
        timer = node.create_timer(0.05, lambda: publisher.publish(message))
        done = bool(wait(node, lambda: state and condition(state[-1].pose.pose.position, state[-1].twist.twist)))
        node.destroy_timer(timer)
        node.destroy_publisher(publisher)
        return done

    def twist(surge: float) -> Twist:
        message = Twist()
        message.linear.x = surge
        return message

    stamped, pose, wrench = TwistStamped(twist=twist(-0.2)), PoseStamped(), WrenchStamped()
    pose.pose.position.x, pose.pose.position.y, pose.pose.position.z, pose.pose.orientation.w = 5.0, 4.0, -2.0, 1.0
    wrench.wrench.force.x = 40.0
    return {
        "cmd_vel": drive("cmd_vel", twist(0.4), lambda _, v: v.linear.x > 0.3),
        "cmd_vel_stamped": drive("cmd_vel_stamped", stamped, lambda _, v: v.linear.x < -0.1),
        "cmd_wrench": drive("cmd_wrench", wrench, lambda _, v: v.linear.x > 0.1),
        "cmd_thrusters": drive(
            "cmd_thrusters", Float64MultiArray(data=[0.0] * 4 + [-20.0] * 2), lambda _, v: abs(v.linear.z) > 0.1
        ),
        "cmd_pose": drive("cmd_pose", pose, lambda p, _: abs(p.x - 5.0) + abs(p.y - 4.0) + abs(p.z + 2.0) < 0.5),
        "cmd_depth": together(node, drive, twist(0.0)),
    }


def together(node: Any, drive: Any, still: Twist) -> bool:
    """Command a depth and a heading, which go with velocities."""
    others = [node.create_publisher(Float64, f"/uuv1/cmd_{what}", 10) for what in ("depth", "heading")]
    timers = [
        node.create_timer(0.05, lambda p=p, v=v: p.publish(Float64(data=v)))
        for p, v in zip(others, (2.6, 1.0), strict=True)
    ]
    done: bool = drive("cmd_vel", still, lambda p, _: abs(p.z + 2.6) < 0.2)
    for timer in timers:
        node.destroy_timer(timer)
    return done


def call(node: Any, kind: Any, name: str, **fields: Any) -> Any:
    client = node.create_client(kind, name)
    assert wait(node, client.service_is_ready), name
    future = client.call_async(kind.Request(**fields))
    assert wait(node, future.done), name
    node.destroy_client(client)
    return future.result()


def serve(node: Any) -> dict[str, Any]:
    """Call every service of standard types."""
    wait(node, lambda: "/uuv1" in names(node) and "/uuv1/arm" in services(node))
    failing = [name for name in services(node) if name.endswith("/fail")]
    began = time.monotonic()
    answers = {name: [call(node, SetBool, name, data=on).success for on in (True, False)] for name in failing}
    return {
        "fail": answers,
        "ms": (time.monotonic() - began) * 1000 / max(1, 2 * len(failing)),
        "armed": [call(node, SetBool, "/uuv1/arm", data=on).message for on in (False, True)],
        "reset": call(node, Trigger, "/uuv1/reset").success,
    }


def parameters(node: Any) -> dict[str, Any]:
    """Use ROS's own client of parameters."""
    client = AsyncParameterClient(node, "/uuv1")
    assert wait(node, client.services_are_ready)

    def result(future: Any) -> Any:
        assert wait(node, future.done)
        return future.result()

    listed = list(result(client.list_parameters()).result.names)
    gain = "gains.surge.p"
    before = result(client.get_parameters([gain])).values[0].double_value
    changes = [Parameter(gain, value=before + 0.5), Parameter("failures.rear_left", value="kind = of")]
    done = [(each.successful, each.reason) for each in result(client.set_parameters(changes)).results]
    return {
        "listed": listed,
        "set": done,
        "change": result(client.get_parameters([gain])).values[0].double_value - before,
        "types": list(result(client.get_parameter_types([gain, "failures.rear_left"])).types),
        "described": [each.name for each in result(client.describe_parameters([gain])).descriptors],
        "atomically": result(client.set_parameters_atomically([Parameter(gain, value=before)])).result.successful,
    }


def plain(value: Any) -> Any:
    """Return a message as dictionaries, lists and numbers."""
    if hasattr(value, "get_fields_and_field_types"):
        return {name: plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, bytes):  # of a field "byte"
        return value[0]
    if isinstance(value, list):
        return [plain(each) for each in value]
    return value.tolist() if hasattr(value, "tolist") else value


def recorded(_: Any) -> dict[str, int]:
    """Return how many messages, by type, have the same fields here as in the file."""
    same: dict[str, int] = {}
    for kind, text, fields in json.loads(Path(sys.argv[2]).read_text()):
        found = plain(deserialize_message(bytes.fromhex(text), load(kind)))
        same[kind] = same.get(kind, 0) + (json.dumps(found) == json.dumps(fields))  # as text, for nan
    return same


TASKS = {task.__name__: task for task in (graph, echo, commands, serve, parameters, recorded)}


def main() -> None:
    rclpy.init()
    node = rclpy.create_node("looks")
    print(json.dumps({name: TASKS[name](node) for name in sys.argv[1].split(",")}), flush=True)
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
