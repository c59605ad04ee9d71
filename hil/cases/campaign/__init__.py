"""Campaigns: a mission many times, with other seeds and parameters, on all processors of a machine or of a cluster.

Public: `runs`, `engines`. It must not print or parse: a command does.
"""
