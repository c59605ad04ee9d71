"""Export of worlds to files of other programs: meshes, Gazebo, GeoTIFF.

Public: one function for each format (`write_gazebo`, `write_geotiff`, `write_stl`, ...); also `gazebo`,
`geotiff`, `mesh`. It must not know charts: a world and its grid are enough.
"""
