"""Export of worlds to files of other programs: meshes, Gazebo, GeoTIFF, and occupancy maps.

Public: one function for each format (`write_gazebo`, `write_geotiff`, `write_stl`, `build_occupancy`, ...); also
`gazebo`, `geotiff`, `mesh`, `occupancy`. It must not know charts: a world and its grid are enough.
"""
