"""Reference page of the topics: name, message type, rate and quality of service, from the table of topics."""

from hil.ros.topics import COMMANDS, TOPICS, Qos, Topic
from sim.sensors.kinds import SENSORS

HEAD = """\
# Topics

All topics carry ROS 2 messages in the frames ENU and FLU (REP 103). `NODE` is the name of the vehicle
(`[slave] node`). A vehicle has the topics of the sensors that are fitted to it. The tables list default
rates; the key `rate` of a sensor changes the rate of its topics. An empty quality of service means
reliable with a depth of 10.

This page is made by `python -m tools.reference` from `hil/ros/topics.py`.

"""
TABLE = "| topic | type | rate (Hz) | quality of service | content |\n|---|---|---|---|---|\n"
# The content of a topic, by its name.
CONTENT = {
    **{stream.topic: stream.meaning for kind in SENSORS.values() for stream in kind.streams},
    "cmd_vel": "speeds (m/s) along the axes of the body, and turn rate (rad/s)",
    "cmd_vel_stamped": "the same with a time and a frame; world frames are refused",
    "cmd_depth": "depth (m), positive down; replaces the vertical speed of `cmd_vel` while that speed is 0",
    "cmd_heading": "heading (rad), clockwise from north; replaces the turn rate of `cmd_vel` while that rate is 0",
    "cmd_pose": "target position (m) and heading, in `map` or `odom`",
    "cmd_wrench": "force (N) and moment (N m) about the body's origin",
    "cmd_thrusters": "thrust (N) of each thruster, in the order of the vehicle file",
    "cmd_accessories": "`lights` (0 to 1), `camera_tilt` (-1 down, 1 up), `gripper` (1 opens, -1 closes, 0 stops)",
    "formation": "the planner's estimate of position and attitude in `map`, and the time on the plan's clock",
    "plan": "planned path, in `map`",
    "modem_tx": "bytes for the modem; the label of the array's dimension is the name of the sender",
    "modem_rx": "bytes that the modem received; the label of the array's dimension is the name of the sender",
    "modem_position": "position of the vehicle `frame_id` from this one (m), by USBL; the time is that of its reply",
    "modem_range": "distance (m), computed from the travel time; `frame_id` is the name of the sender",
    "trace": "sequence number of a command, and its time (ns) at each hop, for the command delay",
    "thruster_wrench": "force (N) and moment (N m) of all thrusters about the body's origin",
    "joint_states": "thrust (N) of each thruster as `effort`, deflection (rad) of each fin as `position`",
    "motors": "a row for each channel: pulse width (µs), speed (rad/s), current (A)",
    "accessories": "where they are: `lights` and `gripper` (0 closed, 1 open) from 0 to 1, `camera_tilt` from -1 to 1",
    "tether": "path from the anchor to the vehicle, in `map`",
    "diagnostics": "[diagnostics](diagnostics.md) of the slave",
    "robot_description": "URDF of the vehicle",
    "map": "map of a planner: 0 free, 100 occupied",
    "obstacles": "markers of the obstacles of the world, in `map`",
    "/diagnostics": "the same diagnostics, on the topic that ROS tools read",
    "/parameter_events": "changes of parameters",
    "/rosout": "lines of the slave's log",
    "/tf": "transform from `odom` to `base_link`, estimated by the navigation",
    "/tf_static": "transforms from `base_link` to each sensor",
    "/clock": "time of the samples",
}


def page() -> str:
    """Return the page of all topics."""
    parts, topics = [HEAD], TOPICS.values()
    for title, chosen in (
        ("Commands to a vehicle", [t for t in topics if t.name in COMMANDS]),
        ("Between the planners of a fleet", [t for t in topics if t.from_master and t.name not in COMMANDS]),
        ("From a vehicle", [t for t in topics if not t.from_master]),
    ):
        parts.append(f"## {title}\n\n{TABLE}{''.join(map(_row, chosen))}\n")
    return "".join(parts).rstrip() + "\n"


def _row(topic: Topic) -> str:
    rate = f"{topic.rate_hz:g}" if topic.rate_hz else "on events"
    qos = (
        [] if topic.qos == Qos() else ["reliable" if topic.qos.reliable else "best effort", f"depth {topic.qos.depth}"]
    )
    qos += ["latched"] if topic.qos.latched else []
    columns = f"`{topic.full_name('NODE')}`", f"`{topic.type}`", rate, ", ".join(qos), CONTENT[topic.name]
    return f"| {' | '.join(columns)} |\n"
