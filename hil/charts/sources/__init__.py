"""Sources of a seabed: S-57 charts, soundings, rasters."""
