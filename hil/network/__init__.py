"""The zenoh network: sessions, publishers, roles, certificates, presence, clock offset, ROS 2 services.

Public: `hil.network.session`, `hil.network.roles`. It must not know who publishes what: slave, master, planner.
"""
