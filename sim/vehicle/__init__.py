"""Vehicles: records read from TOML, hull, thrusters, fins, ballast, battery, failures, URDF import.

Public: `sim.vehicle.vehicle.load_vehicle`. It must not use the environment.
"""
