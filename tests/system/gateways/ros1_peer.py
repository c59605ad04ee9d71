# mypy: disable-error-code="import-not-found"
"""A node of rospy for Debian's Python: it subscribes, commands, calls, and prints a line of JSON."""

import json
import time

import rospy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Image, Imu
from std_srvs.srv import SetBool, Trigger
from tf2_ros import Buffer, TransformListener

PATIENCE_S = 200.0  # for the first picture, whose process gives way to all others


def main() -> None:
    rospy.init_node("pilot", anonymous=True)
    results = {}
    frames = Buffer()
    TransformListener(frames)
    results["accelerations"] = [
        rospy.wait_for_message("/uuv1/imu", Imu, PATIENCE_S).linear_acceleration.z for _ in range(2)
    ]
    results["clock"] = rospy.wait_for_message("/clock", Clock, PATIENCE_S).clock.to_sec()
    image = rospy.wait_for_message("/uuv1/camera/image_raw", Image, PATIENCE_S)
    results["image"] = [image.width, image.height, image.encoding, len(image.data), len(set(image.data)) > 1]
    deadline = time.monotonic() + PATIENCE_S
    while not frames.can_transform("map", "imu_link", rospy.Time(0)) and time.monotonic() < deadline:
        time.sleep(0.05)
    results["depth"] = frames.lookup_transform("map", "imu_link", rospy.Time(0)).transform.translation.z
    speeds = []
    rospy.Subscriber("/uuv1/ground_truth", Odometry, lambda odom: speeds.append(odom.twist.twist.linear.x))
    commands = rospy.Publisher("/uuv1/cmd_vel", Twist, queue_size=1)
    command = Twist()
    command.linear.x = 0.5
    while not (speeds and speeds[-1] > 0.3) and time.monotonic() < deadline:
        commands.publish(command)
        time.sleep(0.05)
    results["speed"] = speeds[-1]
    rospy.wait_for_service("/uuv1/arm", PATIENCE_S)
    arm = rospy.ServiceProxy("/uuv1/arm", SetBool, persistent=True)
    results["armed"] = [arm(False).success, arm(True).message]
    results["reset"] = rospy.ServiceProxy("/uuv1/reset", Trigger)().success
    results["gain"] = rospy.get_param("/uuv1/gains/surge/p")
    results["urdf"] = rospy.get_param("/uuv1/robot_description")[:500]
    print(json.dumps(results))


if __name__ == "__main__":
    main()
