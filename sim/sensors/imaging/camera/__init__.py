"""The camera: its model, and the steps from rays to a picture: light, lamps, particles, motion, image sensor.

Public: `sensor.Camera` and `model.CameraModel`. It must not know sonars.
"""
