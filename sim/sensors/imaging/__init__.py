"""Cameras and imaging sonars, and the appearance of surfaces in their images."""
