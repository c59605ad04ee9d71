"""Things in a world that a file describes in few words: shapes made by rule, pipelines, kinds of seabed, zones.

Public: `read_shapes`, `read_pipelines`, `read_bottom`, `read_zones` and the records they return. It must not know the
world that they are in, nor the rays and sensors that meet them.
"""
