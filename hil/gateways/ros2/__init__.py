"""A bridge to ROS 2 networks of other middlewares (FastDDS, Cyclone): vehicles as nodes of the user's own rclpy.

Public: `bridge`, `interfaces`. It must not know scenarios or slaves. rclpy is not installed with this package: it comes
with the user's ROS.
"""
