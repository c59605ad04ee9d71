"""The planner process: missions, path following, obstacle avoidance, tasks, agents of a fleet.

Public: `hil.master.planner` is the interface of a planner, `hil.master.mission` runs one. This room must not depend on
thruster links.
"""
