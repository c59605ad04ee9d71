"""Flight controllers in the loop: ArduPilot over its JSON interface, PX4 over its HIL messages.

A flight controller receives the samples of the simulated sensors and returns pulse widths for the thrusters. The slave
imports this package only when its scenario has an autopilot.

Public: `hil.autopilots.opening.open_autopilot`, the interface in `hil.autopilots.contract`, and
`hil.autopilots.run.AutopilotRun`, which runs a vehicle with its autopilot in one process; also `frames`, `link_test`,
`parameters`, `px4_files`. This package must not import the slave or the network: samples come in, pulse widths and
reports to the user go out.
"""
