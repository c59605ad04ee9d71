"""Algorithms of an autonomous vehicle: control, allocation, planning, following, avoidance, formations, tasks.

Pure functions and small state machines: no I/O but for reading files, no clock (time is an argument). It imports only
ground-level modules such as `hil.common.schema` and `hil.common.errors`, and knows nothing of the network or the
simulator.
"""
