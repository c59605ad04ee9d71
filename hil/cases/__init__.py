"""The experiments of the reference platform (Zhang et al. 2022), in the simulation and with slaves, measured.

Public: `hil.cases.case`. It must not hold code that a planner or a slave needs.
"""
