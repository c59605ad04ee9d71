"""Vehicles as lines of JSON over TCP: what the package +uuv for MATLAB and Octave speaks, and anything with a socket.

Public: `hil.gateways.json_lines.server.JsonGateway`. A line is a request or its answer. It must not know the slave.
"""
