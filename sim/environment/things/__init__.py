"""Objects that a world's file describes by parameters: generated shapes, pipelines, materials of the seabed, zones.

Public: `read_shapes`, `read_pipelines`, `read_bottom_map`, `read_zones` and the records they return. It must not use
the world that contains them, nor rays and sensors.
"""
