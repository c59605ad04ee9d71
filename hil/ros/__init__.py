"""ROS 2 messages on the wire without ROS: the table of topics, CDR, encoders and decoders, graph tokens, frames.

Public: `hil.ros.topics`, `hil.ros.encoders`, `hil.ros.graph`. It uses samples of the simulator, and must not know
sessions or scenarios.
"""
