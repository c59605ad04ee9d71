"""Steering by hand: sticks, keys and gamepads, and what else a person lets a vehicle do."""
