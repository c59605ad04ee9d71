"""The task scheduler.

Public: `scheduler.Scheduler`. It must not know how a vehicle travels to a task or works on it.
"""
