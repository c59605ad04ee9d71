"""Sea water in layers: density, pressure, speed of sound, sound rays, absorption, and casts of a CTD.

Public: `WaterColumn`, `SoundRays`, `read_cast`, `francois_garrison`, `water_column`. It must not use the world, sensors
or modems.
"""
