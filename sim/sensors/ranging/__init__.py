"""Sensors that measure distances or velocities along beams: sonars, lasers, Doppler logs.

Public: the sensors' classes, which `sim.sensors.sensor_set` names, and `beams`. It must not make images.
"""
