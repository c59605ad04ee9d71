"""The planner process: missions, path following, obstacle avoidance, tasks, agents of a fleet.

Public: `hil.master.planner` is the interface of a planner, `hil.master.mission` runs one; also `acoustic_channel`,
`agent`, `avoid`, `flight`, `guidance`, `hunt`, `manoeuvring`, `progress`, `recorder`, `tasks`. This room must not
depend on thruster links.
"""
