"""Benchmarks of delay, start-up, load, streams and soak runs, and the HIL table.

Public: every module here: the `*_run` modules measure, `table` and `record` report. They must not change what they
measure.
"""
