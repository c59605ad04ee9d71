"""Thruster links between a vehicle's computer and the STM32 that drives its thrusters.

A link is a wire (what carries the bytes) times a protocol (what the bytes mean).

Public: `contract.py` defines both and the messages; `address.py` opens a wire by its address, `protocols.py` a protocol
by its name; also `line_rate`, `options`, `pace`, `search`. It must not know the network, the scenario file or the
simulator.
"""
