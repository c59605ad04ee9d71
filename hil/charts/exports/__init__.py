"""Export of worlds to files of other programs: meshes, Gazebo, GeoTIFF, and occupancy maps."""
