"""Cameras and imaging sonars of a slave, in a process of their own."""
