"""Thruster links: a wire (what carries bytes) times a protocol (what the bytes mean)."""
