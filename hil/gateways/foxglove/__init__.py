"""Vehicles in Foxglove: its websocket protocol, with commands, services and parameters for clients with the token.

Public: `hil.gateways.foxglove.server`, `hil.gateways.commanding`, `hil.gateways.foxglove.scene`,
`hil.gateways.foxglove.layout`. It must not know the slave.
"""
