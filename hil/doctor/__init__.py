"""Findings about a machine: whether it can run a scenario, and the remedies if it cannot.

Public: every module here, and `scenario.check` for scenarios. It must not change anything on the machine, nor know the
command that called it.
"""
