"""Find and handle the sockets of the library's links, which it does not give access to."""

import os
import sys
from collections.abc import Collection, Iterator
from contextlib import suppress
from socket import AF_INET, AF_INET6, SHUT_RDWR, socket

Pair = tuple[int, int]  # the ports of a link, ours and theirs


def cut(pairs: Collection[Pair]) -> None:
    """Shut down this process's connections with these pairs of ports (ours, theirs); the peer reconnects."""
    for pair, end in network_sockets():
        if pair in pairs:
            with suppress(OSError):  # it has just been closed
                end.shutdown(SHUT_RDWR)


def pair_of(ours: str, theirs: str) -> Pair:
    """Return the ports of a link with the addresses "tcp/HOST:PORT?..."; 0 for an address without a port."""
    return _port(ours), _port(theirs)


def network_sockets() -> Iterator[tuple[Pair, socket]]:
    """Yield, for each network socket of this process, its ports (ours, theirs; 0: none) and a duplicated descriptor.

    An OSError that the caller raises with one socket, for example because it was closed, skips to the next. Only Linux
    has the list. psutil would lengthen the slave's start (hil/slave/usage.py), and omits unbound sockets.
    """
    if sys.platform != "linux":
        return
    names: list[str] = []
    with suppress(OSError):  # this process has no descriptor left for the list; it is read again at the next check
        names = os.listdir("/proc/self/fd")
    for name in names:
        with suppress(OSError):
            if os.readlink(f"/proc/self/fd/{name}").startswith("socket:"):
                descriptor = os.dup(int(name))
                try:
                    end = socket(fileno=descriptor)
                except OSError:  # the number has been reused for something else
                    os.close(descriptor)
                    continue
                try:
                    if end.family in (AF_INET, AF_INET6):
                        yield (end.getsockname()[1], _their_port(end)), end
                finally:
                    end.close()


def _their_port(end: socket) -> int:
    try:
        return int(end.getpeername()[1])
    except OSError:  # a listening socket
        return 0


def _port(locator: str) -> int:
    port = locator.partition("?")[0].partition("#")[0].rpartition(":")[2]
    return int(port) if port.isdecimal() else 0
