"""Protocols of MAVLink as machines without sockets and clocks: missions, files, rates, signing.

Public: a class for each protocol, which gets packets and the time and returns packets; for commands, `signing`. It must
not know the vehicle's connection or the endpoints.
"""
