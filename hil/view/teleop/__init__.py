"""Teleoperation: sticks, keys and gamepads, and the commands that they give."""
