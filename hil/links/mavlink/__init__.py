"""MAVLink 2 protocol of a thruster link.

Public: `link.open_mavlink`; `stream.MavlinkStream`, which gateways and autopilots use too; also `reports`, `settings`.
It must not know the wire.
"""
