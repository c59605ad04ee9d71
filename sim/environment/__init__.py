"""The surroundings of a vehicle: water, currents, waves, seabed, obstacles, collision, optics and acoustics.

Public: `world.load_world`, `collision`, `geomagnetism`, `mesh`, `obstacles`, `ocean`, `relief`, `terrain`, `wind`. It
must not use a vehicle's thrusters, nor sensors.
"""
