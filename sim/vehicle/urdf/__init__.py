"""Import of vehicles from URDF files."""
