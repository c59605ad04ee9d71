"""Findings about a vehicle: whether a body of its numbers can exist, and whether it floats and flies.

Public: `rules.check_vehicle`, which yields `finding.Finding`, and the table `rules.RULES`; also `subject`. It must not
read a clock, start processes, or know scenarios and commands.
"""
