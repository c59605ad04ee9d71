"""Thruster messages as a binary frame that a TOML file describes."""
