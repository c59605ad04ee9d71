"""Steer from point to point, without ROS: what a node of yours replaces."""

from math import atan2, cos, hypot, pi, remainder

REACHED_M = 0.5
SLOW_M = 2.0  # from here on to the point it goes slower


def steer(x: float, y: float, yaw: float, target: tuple[float, float], speed: float) -> tuple[float, float, bool]:
    """Return surge (m/s), compass heading (rad from north, clockwise), and whether the target is reached.

    `x` east and `y` north in m (ENU), `yaw` in rad from east, counter-clockwise, as in nav_msgs/Odometry.
    """
    east, north = target[0] - x, target[1] - y
    distance = hypot(east, north)
    heading = atan2(east, north)
    off = remainder(heading - (0.5 * pi - yaw), 2.0 * pi)  # that the bow is off the way to the target
    return speed * min(1.0, distance / SLOW_M) * max(0.0, cos(off)), heading, distance < REACHED_M
