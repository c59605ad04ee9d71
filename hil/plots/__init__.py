"""Figures of runs and vehicles, drawn by matplotlib into files.

Public: `hil.plots.run_plots`, `hil.plots.run_picture`, `hil.plots.vehicle_picture`. It must not run anything.
"""
