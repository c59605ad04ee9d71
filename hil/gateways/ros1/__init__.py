"""Vehicles on a ROS 1 network: a node that publishes their topics, takes commands and answers services.

Public: `hil.gateways.ros1.bridge`. It must not know the slave.
"""
