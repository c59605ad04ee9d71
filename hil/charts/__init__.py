"""Worlds out of charts: readers of charts and soundings, gridding, and files for other simulators."""
