"""Occupancy grids, path search, curves and trajectories, pursuit and obstacle avoidance.

Public: every module here. It must not know worlds or vehicles: maps, scans and positions are arguments, and what
moves a vehicle is returned as a `VelocityCommand`.
"""
