"""Instruments of the ping protocol: Blue Robotics Ping1D, Ping2 and Ping360, Cerulean S500.

Public: the instruments, which `hil.instruments.table` names. They must not know wires or the network.
"""
