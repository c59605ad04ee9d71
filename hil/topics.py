"""One row a topic. Keys, codecs, priorities and the recorder derive from this table."""

from typing import Literal, NamedTuple

Priority = Literal["real_time", "data", "background"]


class Topic(NamedTuple):
    """A stream between slave and master.

    `type` is the ROS 2 message type; `rate_hz` the nominal rate (0: on events); `priority` the place in
    the network's queues; `express` sends at once instead of in batches, which only commands are worth.
    """

    name: str
    type: str
    rate_hz: float
    priority: Priority
    express: bool = False
    from_master: bool = False


TOPICS = {
    topic.name: topic
    for topic in (
        Topic("cmd_vel", "geometry_msgs/msg/Twist", 20, "real_time", express=True, from_master=True),
        Topic("trace", "std_msgs/msg/Int64MultiArray", 20, "real_time"),
        Topic("imu", "sensor_msgs/msg/Imu", 100, "data"),
        Topic("dvl", "geometry_msgs/msg/TwistWithCovarianceStamped", 8, "data"),
        Topic("altitude", "sensor_msgs/msg/Range", 8, "data"),
        Topic("pressure", "sensor_msgs/msg/FluidPressure", 20, "data"),
        Topic("odom", "nav_msgs/msg/Odometry", 20, "data"),
        Topic("ground_truth", "nav_msgs/msg/Odometry", 20, "data"),
        Topic("ahrs", "sensor_msgs/msg/Imu", 100, "data"),
        Topic("altimeter", "sensor_msgs/msg/Range", 10, "data"),
        Topic("battery", "sensor_msgs/msg/BatteryState", 1, "data"),
        Topic("contact", "std_msgs/msg/Bool", 20, "data"),
        Topic("current_meter", "geometry_msgs/msg/TwistStamped", 4, "data"),
        Topic("dvl_water", "geometry_msgs/msg/TwistWithCovarianceStamped", 8, "data"),
        Topic("gps", "sensor_msgs/msg/NavSatFix", 1, "data"),
        Topic("leak", "std_msgs/msg/Bool", 1, "data"),
        Topic("magnetometer", "sensor_msgs/msg/MagneticField", 50, "data"),
        Topic("usbl", "geometry_msgs/msg/PoseWithCovarianceStamped", 1, "data"),
        Topic("diagnostics", "diagnostic_msgs/msg/DiagnosticArray", 1, "background"),
    )
}

# REP 2016 hashes of the definitions in ROS 2 Jazzy; Humble's are the same but for Range, which had no variance.
TYPE_HASHES = {
    "geometry_msgs/msg/Twist": "RIHS01_9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a",
    "geometry_msgs/msg/TwistWithCovarianceStamped": (
        "RIHS01_77b67434531e6529b7a0091357b186b6ebdb17fd9ffd3e0c7ce9d3fb11a44563"
    ),
    "sensor_msgs/msg/Imu": "RIHS01_7d9a00ff131080897a5ec7e26e315954b8eae3353c3f995c55faf71574000b5b",
    "sensor_msgs/msg/FluidPressure": "RIHS01_22dfb2b145a0bd5a31a1ac3882a1b32148b51d9b2f3bab250290d66f3595bc32",
    "sensor_msgs/msg/Range": "RIHS01_b42b62562e93cbfe9d42b82fe5994dfa3d63d7d5c90a317981703f7388adff3a",
    "nav_msgs/msg/Odometry": "RIHS01_3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0",
    "std_msgs/msg/Int64MultiArray": "RIHS01_e60f9fe34d697f0939ad49d33158693c1277fbac0e2f04b7c2995dc21c89b422",
    "diagnostic_msgs/msg/DiagnosticArray": "RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
    "std_msgs/msg/Bool": "RIHS01_feb91e995ff9ebd09c0cb3d2aed18b11077585839fb5db80193b62d74528f6c9",
    "sensor_msgs/msg/NavSatFix": "RIHS01_62223ab3fe210a15976021da7afddc9e200dc9ec75231c1b6a557fc598a65404",
    "sensor_msgs/msg/MagneticField": "RIHS01_e80f32f56a20486c9923008fc1a1db07bbb273cbbf6a5b3bfa00835ee00e4dff",
    "geometry_msgs/msg/PoseWithCovarianceStamped": (
        "RIHS01_26432f9803e43727d3c8f668d1fdb3c630f548af631e2f4e31382371bfea3b6e"
    ),
    "sensor_msgs/msg/BatteryState": "RIHS01_4bee5dfce981c98faa6828b868307a0a73f992ed0789f374ee96c8f840e69741",
    "geometry_msgs/msg/TwistStamped": "RIHS01_5f0fcd4f81d5d06ad9b4c4c63e3ea51b82d6ae4d0558f1d475229b1121db6f64",
}
