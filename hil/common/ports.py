"""Find free ports of this machine for slaves of benchmarks, cases and tests."""

import atexit
import os
import socket
import sys
from functools import cache
from itertools import cycle, islice
from random import SystemRandom

# Below those that Linux hands out by itself, from 32768 on: one of these any connection may take before its slave does.
_FIRST, _END, _BLOCK = 10_000, 31_000, 125 * 2


def free_ports(count: int) -> list[int]:
    """Return free ports whose next one is free too, as a slave uses both; fewer if there are no more.

    No other process that asks here gets them meanwhile, and this one gets others the next 100 times.
    """
    block, ports = _own_block(os.getpid())
    return list(islice((port for port in islice(ports, block) if _is_free(port) and _is_free(port + 1)), count))


@cache
def _own_block(pid: int) -> tuple[int, "cycle[int]"]:
    """Reserve a block of ports for this process by an abstract socket name, which only Linux has.

    Return all ports if none is left.
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
