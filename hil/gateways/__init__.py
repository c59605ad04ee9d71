"""Gateways for other software: lines of JSON over TCP, with a client class for MATLAB and Octave.

Public: `hil.gateways.json_server.JsonGateway`. It knows the Python interface to vehicles (`hil.master`), and nothing
of slaves. Every gateway listens on this machine unless told otherwise, and lets only those command who know its token.
"""
