"""Cameras and imaging sonars of a slave, in their own process."""
