"""The surroundings of a vehicle: water, currents, waves, seabed, obstacles, collision, optics and acoustics.

Public: `sim.environment.world.load_world`. It must not use a vehicle's thrusters, nor sensors.
"""
