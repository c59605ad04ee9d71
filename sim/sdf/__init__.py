"""Read SDF, the format of Gazebo: models with included models, and the poses of their frames.

Public: `files.SdfFiles`, which finds and reads included files; `model.Model`, a model with all nested models in one
frame; `as_urdf.as_urdf`, which converts a vehicle for the importer of `sim.vehicle.urdf`. Axes are those of the file: x
forward and z up for a model; east, north, up for a world. It must not use the network, nor read a mesh.
"""
