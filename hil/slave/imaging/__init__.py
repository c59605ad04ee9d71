"""Cameras and imaging sonars of a slave, in their own process.

Public: `sensors.Imaging`, the slave's side; `process`, the program. It must not make the loop wait for a picture.
"""
