"""Occupancy grids, path search, curves and trajectories, pursuit and obstacle avoidance."""
