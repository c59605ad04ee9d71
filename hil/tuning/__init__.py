"""Tuning of a vehicle's controller gains from step responses in the simulator.

Public: `search`, `picture`, `rig`, `step_response`, `tuned_file`. This package must not import the network.
"""
