"""`uuv-hil topic`: list, echo, hz and pub of ROS 2 topics, without ROS."""
