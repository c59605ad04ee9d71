"""The network: zenoh sessions, ROS 2 names, CDR."""
