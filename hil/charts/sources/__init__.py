"""Readers of seabed data: S-57 charts, soundings, rasters."""
