"""Protocols of MAVLink as machines without sockets and clocks: parameters, missions, files, logs, rates."""
