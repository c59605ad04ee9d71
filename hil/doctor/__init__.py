"""Findings about a machine: whether it can run a scenario, and the remedy where it cannot.

Public: `hil.doctor.findings`. It must not change anything on the machine, nor know
how a person called it.
"""
