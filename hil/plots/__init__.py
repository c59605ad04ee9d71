"""Figures of runs and vehicles, drawn with matplotlib to files.

Public: `hil.plots.run_plots`, `hil.plots.run_picture`, `hil.plots.vehicle_picture`. This package must not run vehicles.
"""
