"""`uuv-hil vehicle`: describe a vehicle; import one from a URDF, SDF or xacro file."""
