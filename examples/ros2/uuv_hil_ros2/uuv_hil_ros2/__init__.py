"""Example nodes for a vehicle of uuv-hil."""
