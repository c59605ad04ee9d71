"""The task scheduler and the state charts it is made of.

Public: `scheduler.Scheduler`. It must not know how a vehicle travels to a task or works on it.
"""
