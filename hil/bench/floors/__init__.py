"""Lower limits of this machine: bare network, bare QEMU, bare loop."""
