"""Figures of runs and vehicles, drawn with matplotlib to files.

Public: `run_plots`, `run_picture`, `vehicle_picture`, `force_log`, `plotting`. This package must not run vehicles.
"""
