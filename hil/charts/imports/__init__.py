"""Worlds and meshes out of other simulators' files: SDF worlds of Gazebo, meshes of many formats.

Public: `meshes.read_meshes`, which measures and converts meshes in a process with limits; `gazebo_world.read_world` and
`gazebo_world.write_world`. It must not fetch anything from a network.
"""
