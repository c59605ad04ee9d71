"""Water as a column of layers: density, pressure, the speed of sound, rays of sound, absorption, and casts of a CTD.

Public: `WaterColumn`, `SoundRays`, `read_cast`, `francois_garrison`. It must not know the world, nor the sensors and
modems that the sound comes to.
"""
