"""Vehicles in Foxglove: its websocket protocol, with commands, services and parameters for clients with the token.

Public: `server`, `scene`, `layout`, `recording`. It must not know the slave.
"""
