"""Dive to a depth and follow a course of points: `ros2 run uuv_hil_ros2 follow_course`.

Parameters: `vehicle` (name of its node), `depth` (m), `speed` (m/s), `points` (east and north in turn, m).
"""

from math import atan2
from typing import Any

import rclpy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rclpy.node import Node
from std_msgs.msg import Float64

from uuv_hil_ros2.steering import steer

PERIOD_S = 0.05  # a vehicle stops when no command comes for half a second


class FollowCourse(Node):
    """Publishes surge, heading and depth commands until the last point is reached."""

    def __init__(self) -> None:
        super().__init__("follow_course")
        vehicle = self.declare_parameter("vehicle", "uuv1").value
        self.depth = float(self.declare_parameter("depth", 3.0).value)
        self.speed = float(self.declare_parameter("speed", 0.5).value)
        flat = [float(x) for x in self.declare_parameter("points", [0.0, 8.0, 4.0, 4.0, 8.0, 0.0]).value]
        self.points = list(zip(flat[::2], flat[1::2], strict=False))
        self.odometry: Any = None
        self.velocity = self.create_publisher(Twist, f"/{vehicle}/cmd_vel", 10)
        self.heading = self.create_publisher(Float64, f"/{vehicle}/cmd_heading", 10)
        self.down = self.create_publisher(Float64, f"/{vehicle}/cmd_depth", 10)
        self.create_subscription(Odometry, f"/{vehicle}/odom", self.on_odometry, 10)
        self.create_timer(PERIOD_S, self.command)

    def on_odometry(self, message: Odometry) -> None:
        """Keep the newest odometry."""
        self.odometry = message

    def command(self) -> None:
        """Publish the commands of this moment."""
        if self.odometry is None or not self.points:
            return
        pose = self.odometry.pose.pose
        q = pose.orientation
        yaw = atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z))
        surge, heading, reached = steer(pose.position.x, pose.position.y, yaw, self.points[0], self.speed)
        if reached:
            self.get_logger().info(f"reached {self.points.pop(0)}")
        velocity = Twist()
        velocity.linear.x = surge
        self.velocity.publish(velocity)
        self.heading.publish(Float64(data=heading))
        self.down.publish(Float64(data=self.depth))


def main() -> None:
    """Run the node until Ctrl-C or SIGTERM; the vehicle's deadman stops it then."""
    rclpy.init()
    node = FollowCourse()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    except Exception:
        if rclpy.ok():  # else SIGTERM came while the node waited or published
            raise
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
