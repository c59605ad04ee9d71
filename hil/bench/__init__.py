"""Benchmarks of delay, start-up, load, jitter, streams and soak runs, and the HIL table.

Public: the `*_run` modules measure, `hil.bench.table` and `hil.bench.record` report. They must not
change what they measure.
"""
