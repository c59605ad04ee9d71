"""Readers of seabed data: S-57 charts, soundings, rasters.

Public: `combine.read_sources` returns a `survey.Survey`; also `sign`. It must not grid the depths, and must not trust a
file: charts are read in a process with limits.
"""
