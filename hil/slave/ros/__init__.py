"""The slave as a ROS 2 node beyond its sensors: services, parameters, transforms, clock, descriptions.

Public: `hil.slave.ros.node`. Loaded after the vehicle is ready. It must not know gateways.
"""
