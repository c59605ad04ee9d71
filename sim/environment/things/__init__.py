"""Objects that a world's file describes by parameters: generated shapes, pipelines, materials of the seabed, zones.

Public: `parse_shapes`, `place_shapes`, `read_bottom_map`, and the records of the other objects; also `bottom_map`,
`natures`, `pipelines`, `shapes`, `zones`. It must not use the world that contains them, nor rays and sensors.
"""
