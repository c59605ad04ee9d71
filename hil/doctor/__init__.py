"""Findings about a machine: whether it can run a scenario, and the remedy where it cannot.

Public: `hil.doctor.findings`. It changes nothing on the machine.
"""
