"""Worlds from charts and soundings: read them, grid depths, place hazards, write files for other programs.

Public: `build`, `build_process`, `chart_survey`, `describe`, `geotiff`, `grid`, `limited`, `picture`, `world_file`. The
slave must not import this package: it loads a world from its file.
"""
