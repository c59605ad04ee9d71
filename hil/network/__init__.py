"""The zenoh network: sessions, publishers, roles, certificates, presence, clock offset, ROS 2 services.

`supervisor` repairs links, `workarounds` has the library's faults.
Public: `session`, `roles`, `buffered`, `certificates`, `clock_offset`, `diagnosis`, `discovery`, `opening`, `presence`,
`publisher`, `reception`, `responder`, `security`, `services`, `settings`, `sockets`, `supervisor`, `tokens`.
It must not know who publishes what: slave, master, planner.
"""
