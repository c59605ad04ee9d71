"""The zenoh network: sessions, publishers, roles, certificates, presence, clock offset, ROS 2 services.

Public: `session`, `roles`, `certificates`, `clock_offset`, `diagnosis`, `discovery`, `opening`, `presence`,
`publisher`, `router_links`, `security`, `services`, `settings`, `sockets`, `stall`, `tokens`, `unread_links`. It must
not know who publishes what: slave, master, planner.
"""
