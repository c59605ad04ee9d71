"""Worlds from charts and soundings: read, grid, find hazards, write files for other simulators.

Public: `hil.charts.build`. It must not be imported by the slave: a built world is a file.
"""
