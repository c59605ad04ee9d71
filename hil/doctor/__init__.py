"""Findings about a machine: whether it can run a scenario, and the remedies if it cannot.

Public: `hil.doctor.findings`. It must not change anything on the machine, nor know the command that called it.
"""
