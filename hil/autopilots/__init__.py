"""Flight controllers in the loop: ArduPilot over its JSON interface, PX4 over its HIL messages.

A flight controller gets the samples of our sensors and returns pulse widths for the thrusters. The slave reaches this
room by name, when its scenario asks for an autopilot.

Public: `hil.autopilots.opening.open_autopilot`, the interface in `hil.autopilots.contract`, and
`hil.autopilots.run.AutopilotRun`, which runs a vehicle with its autopilot in one process. It must not know the slave
nor the network: samples come in, pulse widths and lines for a person go out.
"""
