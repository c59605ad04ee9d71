"""The surroundings of a vehicle: water, currents, waves, seabed, obstacles, collision, optics and acoustics.

Public: `sim.environment.world.load_world`. It must not know a vehicle but for its hull.
"""
