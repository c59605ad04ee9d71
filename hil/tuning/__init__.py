"""Tuning of a vehicle's controller gains from step responses in the simulator.

Public: `hil.tuning.search`. This package must not import the network.
"""
