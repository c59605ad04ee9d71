"""Flights of the target hunting case ("hunts"): simulated in one process, or with separate processes and an observer.

Public: `simulated.SimulatedHunt` and `processes.fly`, which pass rows to a `watch.HuntWatch`; `picture.draw_hunt`. It
must not decide when a hunt has succeeded: `hil.autonomy.fleets.hunting` does.
"""
