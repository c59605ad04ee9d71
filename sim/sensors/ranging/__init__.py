"""Sensors that measure distances or velocities along beams: sonars, lasers, Doppler logs."""
