"""Vehicles: records read from TOML, hull, thrusters, fins, ballast, battery, failures, URDF import.

Public: `sim.vehicle.vehicle.load_vehicle`. It must not know the environment's records but for what flows past the hull.
"""
