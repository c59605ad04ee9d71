"""Sea water in layers: density, pressure, speed of sound, sound rays, and absorption.

Public: `WaterColumn`, `SoundRays`, `francois_garrison`, `water_column`, `pressure`. It must not use the
world, sensors or modems.
"""
