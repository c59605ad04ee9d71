"""Thruster frames that a TOML file describes."""
