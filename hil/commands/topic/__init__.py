"""`uuv-hil topic`: list, echo, hz, pub and call for ROS 2 topics and services, without ROS."""
