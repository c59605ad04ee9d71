"""The live view of vehicles in a browser, and teleoperation.

Public: `live_view.LiveView`, `pace`. It shows the samples of a `Source` (the network, a recording, a simulation) and
commands vehicles through `hil.client`. The page draws everything; this room sends it what to draw. It must not know how
a vehicle is simulated, and a slave must not know of it.
"""
