"""The surroundings of a vehicle: water, currents, waves, seabed, obstacles, collision, optics and acoustics.

Public: `world.load_world`, `bottom`, `collision`, `geomagnetism`, `mesh`, `obstacles`, `ocean`, `optics`, `relief`,
`terrain`, `wind`. It must not use a vehicle's thrusters, nor sensors.
"""
