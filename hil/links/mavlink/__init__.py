"""Thruster messages as MAVLink 2."""
