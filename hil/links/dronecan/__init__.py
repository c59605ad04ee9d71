"""Thrusters as the ESCs of a DroneCAN node."""
