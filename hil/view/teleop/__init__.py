"""Teleoperation: sticks, and the commands that they give.

Public: `steering.Steering`. It must not know the scene.
"""
