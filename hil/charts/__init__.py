"""Worlds from charts and soundings: read them, grid depths, place hazards, write files for other simulators.

Public: `hil.charts.build`. The slave must not import this package: it loads a world from its file.
"""
