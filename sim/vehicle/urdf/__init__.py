"""Import vehicles from URDF files, and export them. SDF files are converted by sim.sdf first.

Public: `importer.read_urdf`, `importer.read_robot`, `writer.urdf_of`, `pose`, `ros_packages`, `sdf_pose`, `shapes`,
`text`. It must not use worlds or the simulation.
"""
