"""The simulator: vehicle, environment, sensors, and the step that advances them.

Public: `sim.simulation.Simulation`, `sim.assembly`. No input or output, no threads, no clock: time comes in.
"""
