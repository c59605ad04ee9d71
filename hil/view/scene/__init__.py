"""What the page draws of a scenario: world, water, vehicles and their sensors, as one file of numbers.

Public: `content.SceneContent`, `content.encode_content`, `world.nodes`, `world.triangles`. It must not know where
samples come from, nor command vehicles. Positions are NED and FRD in m; the page converts them to its axes.
"""
