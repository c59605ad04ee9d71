"""Algorithms of an autonomous vehicle: control, allocation, planning, following, avoidance, formations, tasks.

Public: every module here; pure functions and small state machines: no I/O but for reading files, no clock (time is an
argument). It imports only `hil.common`, and must not know the network or the simulator.
"""
