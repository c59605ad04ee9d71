"""Cameras and imaging sonars, and the scenery that they show."""
