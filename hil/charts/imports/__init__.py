"""Import of worlds and meshes from files of other simulators: Gazebo's SDF worlds, meshes of many formats.

Public: `meshes.read_meshes`, which measures and converts meshes in a process with limits, and
`gazebo_world.import_world`. This package must not fetch anything from a network.
"""
