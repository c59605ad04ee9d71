"""Lower limits of this machine: bare network, bare QEMU, bare loop.

Public: `network.serve` and `network.Floor`, `bare_slave`, `bare_qemu`. They must not use the slave's loop: what they
measure is the cost without it.
"""
