"""Read SDF, the format of Gazebo: models, what they include, and the poses of their frames.

Public: `files.SdfFiles`, which finds and reads what is included; `model.Model`, a model with all that is nested in it
in one frame; `as_urdf.as_urdf`, which hands a vehicle to the importer of `sim.vehicle.urdf`. Axes are those of the
file: x forward and z up of a model, east, north, up of a world. It must not know the network, nor read a mesh.
"""
