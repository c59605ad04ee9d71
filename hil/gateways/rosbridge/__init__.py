"""Vehicles in the protocol of rosbridge (v2, websocket, JSON and CBOR), with commands for clients with the token.

Public: `hil.gateways.rosbridge.server`. It must not know the slave.
"""
