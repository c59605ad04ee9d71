"""The Python interface to vehicles: fleet, vehicle, samples, actions, liveness, command delay.

Public: `hil.connect` returns `hil.client.fleet.Fleet`. It must not know how a vehicle is driven inside its slave.
"""
