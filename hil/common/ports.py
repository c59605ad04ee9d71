"""Find free ports on this machine for slaves of benchmarks, cases and tests."""

import atexit
import os
import socket
import sys
from functools import cache
from itertools import cycle, islice
from random import SystemRandom

# Below Linux's ephemeral ports (from 32768), which any connection may take before the slave does.
_FIRST, _END, _BLOCK = 10_000, 31_000, 125 * 2


def free_ports(count: int) -> list[int]:
    """Return `count` free ports whose next port is free too, as a slave uses both; fewer if there are no more.

    Other processes that call this get other ports; this process gets the same port again only after about 100 calls.
    """
    block, ports = _own_block(os.getpid())
    return list(islice((port for port in islice(ports, block) if _is_free(port) and _is_free(port + 1)), count))


@cache
def _own_block(pid: int) -> tuple[int, "cycle[int]"]:
    """Reserve a block of ports for this process by an abstract socket name, which only Linux has.

    Return how many ports there are, and an endless iterator over them. Without a free block these are all ports.
    """
    blocks = list(range(_FIRST, _END, _BLOCK)) if sys.platform == "linux" else []
    for first in SystemRandom().sample(blocks, len(blocks)):
        holder = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            holder.bind(f"\0uuv-hil-ports-{first}")
        except OSError:
            holder.close()
            continue
        atexit.register(holder.close)
        return _BLOCK // 2, cycle(range(first, first + _BLOCK, 2))
    ports = range(_FIRST, _END, 2)
    return len(ports), cycle(SystemRandom().sample(ports, len(ports)))


def _is_free(port: int) -> bool:
    with socket.socket() as probe:
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return False
    return True
