"""`uuv-hil vehicle`: describe a vehicle; import one from a URDF or xacro file."""
