"""The Python interface to vehicles: fleet, vehicle, samples, actions, liveness, command delay.

Public: `hil.connect` returns `hil.client.fleet.Fleet`; also `action`, `client`, `delay`, `health_watch`,
`message_text`, `parameters`, `samples`, `services`, `topics`, `vehicle_handle`. It must not know how a vehicle is
driven inside its slave.
"""
