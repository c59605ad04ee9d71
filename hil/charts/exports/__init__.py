"""Worlds as files of other programs: meshes, Gazebo, GeoTIFF, and maps for planners."""
