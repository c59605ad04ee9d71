"""Lower limits of this machine: bare network, bare loop.

Public: `network.serve` and `network.Floor`, `bare_slave`. They must not use the slave's loop: what they
measure is the cost without it.
"""
