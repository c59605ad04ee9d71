"""The surroundings of a vehicle: water, currents, waves, seabed, obstacles, collision, optics and acoustics.

Public: `sim.environment.world.load_world`. Of a vehicle it must use only the hull.
"""
