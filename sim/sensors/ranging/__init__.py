"""Sensors that measure distances or velocities along beams."""
