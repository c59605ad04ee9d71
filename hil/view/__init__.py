"""The live view of vehicles in a browser, and teleoperation.

Public: `hil.view.live_view.LiveView`. It shows what a `Source` gives (the network, a recording, a simulation) and
commands through `hil.client`; it must not know how a vehicle is simulated, and a slave must not know of it.
"""
