"""Symptom: a link is open, keep-alives go out, and nothing of what arrives on it is ever read.

The library opens a link in three steps: it starts the writing task, notifies its listeners, and starts the reading
task. If its timeout for opening a link ends in between, as can happen after a process was paused, the third step never
comes. A link that works gets keep-alives several times a lease, or the library closes it. The kernel knows how many
bytes were received and how many still wait to be read.

Report: docs/upstream/zenoh_pause.md. Remove when `test_the_report_of_an_unread_link_is_reproduced` fails.
"""

import sys
from collections.abc import Collection, Mapping
from contextlib import suppress
from struct import unpack_from

from hil.common.clock import NS_PER_S
from hil.network.sockets import Pair, network_sockets

LEASES = 2
_TCP, _TCP_INFO, _TCP_INFO_SIZE, _BYTES_RECEIVED = 6, 11, 136, 128  # linux/tcp.h


class UnreadLinks:
    """Detect links from which nothing was read for two leases (of `lease` s), although bytes wait.

    A busy machine must not lose working links. So only time in which this process ran counts.
    """

    def __init__(self, lease: float) -> None:
        self._patience_ns = round(LEASES * lease * NS_PER_S)
        self._unread: dict[Pair, tuple[int, int]] = {}  # link -> bytes read so far, ns since that number changed

    def find(self, passed_ns: int, progress: Mapping[Pair, int]) -> set[Pair]:
        """Return these links. `passed_ns`: time since the last call. `progress`: see `read_progress`."""
        known, self._unread = self._unread, {}
        for pair, read in progress.items():
            before, lasted_ns = known.get(pair, (-1, 0))
            self._unread[pair] = read, (lasted_ns + passed_ns if read == before else 0)
        return {pair for pair, (_, lasted_ns) in self._unread.items() if lasted_ns >= self._patience_ns}


def read_progress(pairs: Collection[Pair]) -> dict[Pair, int]:
    """Return the bytes read so far on each of this process's connections with waiting bytes.

    Works on Linux only; elsewhere the result is empty.
    """
    if sys.platform != "linux":
        return {}
    from fcntl import ioctl
    from termios import FIONREAD

    progress = {}
    for pair, end in network_sockets():
        if pair not in pairs:
            continue
        with suppress(OSError):  # it has just been closed
            info = end.getsockopt(_TCP, _TCP_INFO, _TCP_INFO_SIZE)
            waiting = int.from_bytes(ioctl(end.fileno(), FIONREAD, bytes(4)), "little")
            if waiting and len(info) == _TCP_INFO_SIZE:  # smaller before Linux 4.1
                progress[pair] = unpack_from("<Q", info, _BYTES_RECEIVED)[0] - waiting
    return progress
