"""Table of topics, one row each. Keys, codecs, priorities and the recorder are derived from it."""

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

# REP 2016 hashes of the definitions in ROS 2 Jazzy. Humble has the same definitions, except Range without variance.
TYPE_HASHES = {
    "geometry_msgs/msg/Twist": "RIHS01_9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a",
    "geometry_msgs/msg/TwistWithCovarianceStamped": (
        "RIHS01_77b67434531e6529b7a0091357b186b6ebdb17fd9ffd3e0c7ce9d3fb11a44563"
    ),
    "sensor_msgs/msg/Imu": "RIHS01_7d9a00ff131080897a5ec7e26e315954b8eae3353c3f995c55faf71574000b5b",
    "sensor_msgs/msg/FluidPressure": "RIHS01_22dfb2b145a0bd5a31a1ac3882a1b32148b51d9b2f3bab250290d66f3595bc32",
    "sensor_msgs/msg/LaserScan": "RIHS01_64c191398013af96509d518dac71d5164f9382553fce5c1f8cca5be7924bd828",
    "sensor_msgs/msg/Range": "RIHS01_b42b62562e93cbfe9d42b82fe5994dfa3d63d7d5c90a317981703f7388adff3a",
    "nav_msgs/msg/Odometry": "RIHS01_3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0",
    "std_msgs/msg/Int64MultiArray": "RIHS01_e60f9fe34d697f0939ad49d33158693c1277fbac0e2f04b7c2995dc21c89b422",
    "std_msgs/msg/Float64": "RIHS01_705ba9c3d1a09df43737eb67095534de36fd426c0587779bda2bc51fe790182a",
    "std_msgs/msg/Float64MultiArray": "RIHS01_1025ddc6b9552d191f89ef1a8d2f60f3d373e28b283d8891ddcc974e8c55397f",
    "geometry_msgs/msg/PoseStamped": "RIHS01_10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8",
    "diagnostic_msgs/msg/DiagnosticArray": "RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
    "std_msgs/msg/Bool": "RIHS01_feb91e995ff9ebd09c0cb3d2aed18b11077585839fb5db80193b62d74528f6c9",
    "sensor_msgs/msg/NavSatFix": "RIHS01_62223ab3fe210a15976021da7afddc9e200dc9ec75231c1b6a557fc598a65404",
    "sensor_msgs/msg/MagneticField": "RIHS01_e80f32f56a20486c9923008fc1a1db07bbb273cbbf6a5b3bfa00835ee00e4dff",
    "geometry_msgs/msg/PoseWithCovarianceStamped": (
        "RIHS01_26432f9803e43727d3c8f668d1fdb3c630f548af631e2f4e31382371bfea3b6e"
    ),
    "sensor_msgs/msg/BatteryState": "RIHS01_4bee5dfce981c98faa6828b868307a0a73f992ed0789f374ee96c8f840e69741",
    "geometry_msgs/msg/TwistStamped": "RIHS01_5f0fcd4f81d5d06ad9b4c4c63e3ea51b82d6ae4d0558f1d475229b1121db6f64",
    "geometry_msgs/msg/WrenchStamped": "RIHS01_8dc3deaf06b2ab281f9f9a742a8961c328ca7cec16e3fd6586d3a5c83fa78f77",
    "marine_acoustic_msgs/msg/Dvl": "RIHS01_77604ba1b113d1a39148d095ac2cb21540de83cff2bbc5443e06e25208afd421",
    "tf2_msgs/msg/TFMessage": "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
    "trajectory_msgs/msg/MultiDOFJointTrajectoryPoint": (
        "RIHS01_6ada1085b5ee64eaa069b074968e69f0e27c8c5e6f5bb0586dd1c834ef0e32b8"
    ),
    "std_msgs/msg/String": "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
    "nav_msgs/msg/OccupancyGrid": "RIHS01_8d348150c12913a31ee0ec170fbf25089e4745d17035792a1ba94d6f0bc0cfc7",
    "visualization_msgs/msg/MarkerArray": "RIHS01_86cb8800b6fb05b5eff1abd7a56f62a5641d3ae9a1c29e78e67e704f1d067dcf",
    "rosgraph_msgs/msg/Clock": "RIHS01_692f7a66e93a3c83e71765d033b60349ba68023a8c689a79e48078bcb5c58564",
}


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
