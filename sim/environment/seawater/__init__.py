"""Sea water in layers: density, pressure, speed of sound, and absorption.

Public: `WaterColumn`, `francois_garrison`, `water_column`, `pressure`. It must not use the world, sensors or modems.
"""
