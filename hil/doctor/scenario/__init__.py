"""Checks of a scenario without running it, for `uuv-hil scenario check`.

Public: `check.check_scenario`, which yields findings. It must not start processes or open devices.
"""
