"""Find free ports of this machine for slaves of benchmarks, cases and tests."""

import socket
from random import SystemRandom

# Below those that Linux hands out by itself, from 32768 on: one of these any connection may take before its slave does.
_PORTS = range(10_000, 31_000, 2)


def free_ports(count: int) -> list[int]:
    """Ports that nobody listens on, and of each the next one too, which a slave also takes."""
    found: list[int] = []
    for port in SystemRandom().sample(_PORTS, len(_PORTS)):
        if len(found) == count:
            break
        if _is_free(port) and _is_free(port + 1):
            found.append(port)
    return found


def _is_free(port: int) -> bool:
    with socket.socket() as probe:
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return False
    return True
