"""MAVLink 2 vehicle of a slave without an autopilot, for ground stations and companion software.

Public: `gateway` and the section [mavlink] (hil.scenario.mavlink_records); also `assembly`, `parameter_table`,
`vehicle_port`. A process of its own that commands and observes one vehicle by `hil.client`,
under the same rules as any master. Protocol machines (missions, files, streams, modes) get packets and the
time, and return packets: they have no sockets and no clock. It must not know how a vehicle is driven inside its slave.
"""
