"""The simulator: vehicle, environment, sensors, and the step that advances them.

Public: `sim.simulation.Simulation`, `sim.assembly`. It must not do input or output,
start threads or read a clock: time comes in as an argument.
"""
