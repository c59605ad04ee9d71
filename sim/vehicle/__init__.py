"""Vehicles: records read from TOML, hull, thrusters, fins, ballast, battery, failures, URDF import.

Public: `vehicle.load_vehicle`, `accessories`, `ballast`, `battery`, `body_lift`, `collision_shape`, `equipment`,
`failures`, `fins`, `hull_form`, `hydrostatics`, `mesh_files`, `meshes`, `servos`, `terminal_speed`. It must not use the
environment.
"""
