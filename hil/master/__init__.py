"""The planner process: missions, path following, obstacle avoidance, tasks, agents of a fleet.

Public: `hil.master.planner` is what a planner is, `hil.master.mission` flies one. It must not know thruster links.
"""
