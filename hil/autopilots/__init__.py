"""Flight controllers in the loop: ArduPilot over its JSON interface, PX4 over its HIL messages.

A flight controller gets the samples of our sensors and returns pulse widths for the thrusters. Public are
`open_autopilot` (hil.autopilots.opening), the interface in hil.autopilots.contract, and `AutopilotRun`
(hil.autopilots.run), which runs a vehicle with its autopilot in one process. The slave reaches this room by name, when
its scenario asks for an autopilot. The
room knows neither the slave nor the network: what it needs of a vehicle comes in as samples, what it says goes out as
pulse widths and as lines for a person.
"""
