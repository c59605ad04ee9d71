"""Gateways for other software: lines of JSON over TCP, rosbridge, Foxglove, MAVLink; a package for MATLAB and Octave.

Public: a server in each folder; also `commanding` and `prometheus`. They know the Python interface to vehicles
(`hil.client`), and they must not know slaves. Every gateway listens on this machine alone by default, and lets only
those command who know its token.
"""
