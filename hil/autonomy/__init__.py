"""Algorithms of an autonomous vehicle: control, allocation, planning, following, avoidance, formations, tasks.

Public: every module here; pure functions and small state machines. They do no I/O except reading files, and use no
clock (time is an argument). This package imports only `hil.common`, and must not import the network or the simulator.
"""
