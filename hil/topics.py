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
        Topic("diagnostics", "diagnostic_msgs/msg/DiagnosticArray", 1, "background"),
    )
}
