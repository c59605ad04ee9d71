"""Teleoperation: sticks, keys and gamepads, and the commands that they give.

Public: `steering.Steering`, with a stick from `keys.Keys` or `gamepad.Gamepad`. It must not know the scene.
"""
