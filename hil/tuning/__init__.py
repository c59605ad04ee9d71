"""Gains for a vehicle's controller, from step responses in the simulator.

Public: `hil.tuning.search`. It must not know the network.
"""
