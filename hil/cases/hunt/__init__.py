"""Hunts of the target hunting case: simulated in one process, or flown by processes of their own, and observed.

Public: `simulated.SimulatedHunt` and `processes.fly`, which report to a `watch.HuntWatch`; `picture.draw_hunt`.
"""
