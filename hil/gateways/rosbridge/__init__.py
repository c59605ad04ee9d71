"""Vehicles in rosbridge's protocol (v2, websocket, JSON and CBOR), with commands and services for who has the token.

Public: `hil.gateways.rosbridge.server`. It must not know the slave.
"""
