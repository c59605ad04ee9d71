"""ROS 2 messages on the wire without ROS: the table of topics, CDR, encoders and decoders, graph tokens, frames.

Public: `topics`, `encoders`, `graph`, `commands`, `diagnostics`, `dialect`, `dvl`, `fleet`, `frames`, `images`,
`joints`, `message`, `own`, `plan`, `world`. It uses samples of the simulator, and must not know sessions or
scenarios.
"""
