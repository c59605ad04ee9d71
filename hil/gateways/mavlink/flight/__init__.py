"""Modes, sticks, targets and missions: from what a person wants to the command of the vehicle. Pure."""
