"""Table of topics, one row each. Keys, codecs, priorities and the recorder are derived from it."""

import os
from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal, NamedTuple

from hil.ros import dialect
from sim.sensors.kinds import SENSORS, Kind

Priority = Literal["real_time", "data", "background"]


class Qos(NamedTuple):
    """Quality of service as in ROS 2. A late subscriber to a `latched` topic gets its last messages."""

    reliable: bool = True
    latched: bool = False
    depth: int = 10


class Topic(NamedTuple):
    """A stream between slave and master.

    `name` is relative to the node's name, or with a leading slash the same for all nodes. `type` is the ROS 2 message
    type; `rate_hz` the nominal rate (0: on events); `priority` the queue in the network. `express` messages are sent at
    once instead of in batches, which is worth it for commands only. `qos` is announced to ROS 2 (REP 2003: sensors are
    reliable).
    """

    name: str
    type: str
    rate_hz: float
    priority: Priority
    express: bool = False
    from_master: bool = False
    qos: Qos = Qos()

    def full_name(self, node: str) -> str:
        """Return the topic's full ROS name for that node."""
        return self.name if self.name.startswith("/") else f"/{node}/{self.name}"


FAN = "fan/image_raw"  # topic of a forward-looking sonar, below its name
_DESCRIPTION = Qos(latched=True, depth=1)


def topics_of(kind: Kind) -> list[Topic]:
    """Return the topics of a kind of sensor."""
    return [Topic(each.topic, each.message, each.rate_hz, each.priority) for each in kind.streams]


TOPICS = {
    topic.name: topic
    for topic in (
        Topic("cmd_vel", "geometry_msgs/msg/Twist", 20, "real_time", express=True, from_master=True),
        Topic("cmd_vel_stamped", "geometry_msgs/msg/TwistStamped", 20, "real_time", express=True, from_master=True),
        Topic("cmd_depth", "std_msgs/msg/Float64", 20, "real_time", express=True, from_master=True),
        Topic("cmd_heading", "std_msgs/msg/Float64", 20, "real_time", express=True, from_master=True),
        Topic("cmd_pose", "geometry_msgs/msg/PoseStamped", 20, "real_time", express=True, from_master=True),
        Topic("cmd_wrench", "geometry_msgs/msg/WrenchStamped", 20, "real_time", express=True, from_master=True),
        Topic("cmd_thrusters", "std_msgs/msg/Float64MultiArray", 20, "real_time", express=True, from_master=True),
        Topic("cmd_accessories", "sensor_msgs/msg/JointState", 0, "real_time", express=True, from_master=True),
        Topic("trace", "std_msgs/msg/Int64MultiArray", 20, "real_time"),
        *[topic for kind in SENSORS.values() for topic in topics_of(kind)],
        Topic("thruster_wrench", "geometry_msgs/msg/WrenchStamped", 10, "data"),
        Topic("joint_states", "sensor_msgs/msg/JointState", 10, "data"),
        Topic("motors", "std_msgs/msg/Float64MultiArray", 10, "data"),
        Topic("accessories", "sensor_msgs/msg/JointState", 10, "data"),
        Topic("tether", "nav_msgs/msg/Path", 10, "data"),
        Topic(
            "formation", "trajectory_msgs/msg/MultiDOFJointTrajectoryPoint", 10, "data", express=True, from_master=True
        ),
        Topic("plan", "nav_msgs/msg/Path", 1, "data", from_master=True),
        Topic("modem_tx", "std_msgs/msg/UInt8MultiArray", 1, "data", from_master=True),
        Topic("modem_rx", "std_msgs/msg/UInt8MultiArray", 3, "data", from_master=True),
        Topic("modem_range", "sensor_msgs/msg/Range", 3, "data", from_master=True),
        Topic("modem_position", "geometry_msgs/msg/PoseWithCovarianceStamped", 1, "data", from_master=True),
        Topic("diagnostics", "diagnostic_msgs/msg/DiagnosticArray", 1, "background"),
        Topic("robot_description", "std_msgs/msg/String", 0, "background", qos=_DESCRIPTION),
        Topic("map", "nav_msgs/msg/OccupancyGrid", 0, "background", qos=_DESCRIPTION),
        Topic("obstacles", "visualization_msgs/msg/MarkerArray", 0, "background", qos=_DESCRIPTION),
        Topic("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", 1, "background"),
        Topic("/rosout", "rcl_interfaces/msg/Log", 0, "background", qos=Qos(latched=True, depth=1000)),
        Topic("/parameter_events", "rcl_interfaces/msg/ParameterEvent", 0, "background", qos=Qos(depth=1000)),
        Topic("/tf", "tf2_msgs/msg/TFMessage", 20, "data", qos=Qos(depth=100)),
        Topic("/tf_static", "tf2_msgs/msg/TFMessage", 0, "data", qos=Qos(latched=True, depth=1)),
        Topic("/clock", "rosgraph_msgs/msg/Clock", 20, "data", qos=Qos(reliable=False, depth=1)),
    )
}

OURS = tuple(TOPICS)  # topics of this table, without those added for additional sensors and users' own

# Topics on which a sensor's samples are published, by the simulator's name of its samples; pictures have none here.
_SAMPLE_TOPICS = {
    kind.topic: tuple([stream.topic for stream in kind.streams if stream.priority == "data"])
    for kind in SENSORS.values()
}
_SAMPLE_TOPICS["odom"] = ("odom", "/tf")
_FURTHER = {topic for topics in _SAMPLE_TOPICS.values() for topic in topics[1:]}  # never the only topic of a sensor

ALL = "*"  # all topics of a node except pictures
DESCRIPTIONS = ("robot_description", "map", "obstacles")  # published only after a subscription
COMMANDS = tuple([name for name in TOPICS if name.startswith("cmd_")])  # topics of commands to a vehicle

# REP 2016 hashes, from types/*.msg, of what a vehicle publishes: so it need not read the definitions. They are those of
# ROS 2 Jazzy; Humble has the same definitions, except Range without variance.
with open(os.path.join(os.path.dirname(__file__), "types", "published.txt"), encoding="ascii") as _file:
    TYPE_HASHES: dict[str, str] = dict(line.split() for line in _file)

_alike: dict[str, str] = {}  # name or topic of an additional sensor -> that of the first sensor of its kind


def first_of(name: str) -> str:
    """Return the corresponding name or topic of the first sensor of the kind: "camera/labels" for "left/labels"."""
    return _alike.get(name, name)


def sample_topics(name: str) -> tuple[str, ...]:
    """Return the topics for samples of that name; empty for sensors with pictures."""
    first = first_of(name)
    topics = _SAMPLE_TOPICS.get(first) or ((first,) if first in TOPICS else ())
    return topics if name == first else tuple([_renamed(topic, first, name) for topic in topics])


def further_topics(name: str, first: str) -> dict[str, str]:
    """Return the topics of an additional sensor `name`, of the kind whose samples are called `first`.

    Each maps to the corresponding topic of the first sensor of the kind.
    """
    rows = [*sample_topics(first), *[topic for topic in OURS if topic.startswith(f"{first}/")]]
    return {_renamed(topic, first, name): topic for topic in rows}


def add_further(name: str, first: str) -> None:
    """Register the topics of an additional sensor in this process."""
    _alike[name] = first
    for topic, row in further_topics(name, first).items():
        TOPICS[topic], _alike[topic] = TOPICS[row]._replace(name=topic), row


def learn(topic: str, type_name: str, published: Mapping[str, str] = MappingProxyType({})) -> bool:
    """Add a topic that a vehicle's node publishes, if it corresponds to a sensor's topic here; return whether it does.

    A process thus learns of additional sensors whose scenario it has not read. `published` has the types of all topics
    of the node. Among kinds with a topic of this type, the one with most of its topics in `published` is chosen.
    """
    if topic in TOPICS:
        return True
    name, _, suffix = topic.partition("/")
    kinds = []
    for row in [TOPICS[each] for each in OURS if TOPICS[each].type == type_name]:
        first, _, end = row.name.partition("/")
        is_own = end or row.name not in _FURTHER or topic.endswith(f"_{row.name}")
        if end == suffix and first and is_own and not row.from_master and row.priority != "real_time":
            kinds.append(first)
    if not kinds:
        return False

    def share(first: str) -> int:
        return sum(published.get(each) == TOPICS[row].type for each, row in further_topics(name, first).items())

    add_further(name, max(kinds, key=share))
    return True


def _renamed(topic: str, first: str, name: str) -> str:
    """Return a kind's topic as that of its sensor `name`: "dvl_twist" as "aft_twist", "altitude" as "aft_altitude"."""
    if topic == first or topic.startswith((f"{first}/", f"{first}_")):
        return name + topic[len(first) :]
    return f"{name}_{topic}"


def is_picture(topic: str) -> bool:
    """Return whether a node's topic has pictures; a subscription to all topics leaves them out."""
    return "/" in topic[1:]


def hash_of(type_name: str) -> str:
    """Return the hash of any known type, for the present release of ROS.

    Raises ConfigError for an unknown type.
    """
    if dialect.is_humble():
        return dialect.NO_HASH
    digest = TYPE_HASHES.get(type_name)
    if digest is None:
        from hil.ros import types  # only for types that the vehicle does not publish

        digest = types.type_hash(type_name)
    return digest
