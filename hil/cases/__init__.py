"""The experiments of the reference platform (Zhang et al. 2022), run in simulation and with slaves, and measured.

Public: `campaign`, `case`, `flights`, `report`, `simulated`, `table`, `viewer`. This package must not contain code
that a planner or a slave needs.
"""
