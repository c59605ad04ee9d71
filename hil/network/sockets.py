"""Handle zenoh's sockets directly: close lost links at once, close unread links, limit queues and buffers.

The library's sockets linger: closing one with unacknowledged bytes blocks a thread of the library for up to 10 s. That
thread may be the one that accepts or opens the next link (eclipse-zenoh/zenoh#2350, tokio-rs/tokio#7751): after an
outage of 7 s the link came back up to 14 s later. So linger is disabled on each new link. The kernel still sends what
is queued when a session closes.
"""

import os
import sys
from collections.abc import Collection, Iterator
from contextlib import suppress
from socket import AF_INET, AF_INET6, SHUT_RDWR, SO_ACCEPTCONN, SO_LINGER, SO_SNDBUF, SOL_SOCKET, socket
from struct import pack

import zenoh

from hil.network.settings import SEND_BUFFER

WAITING = 0  # length of a listener's queue; the kernel adds one
DO_NOT_LINGER = pack("ii", 0, 0)  # struct linger: off


def free_new(link: zenoh.LinkEvent) -> None:
    """Disable linger on the socket of a new link."""
    if link.kind == zenoh.SampleKind.PUT:
        free_sockets()


def free_sockets() -> None:
    """Disable linger on all network sockets of this process: 0.1 ms for the about twenty descriptors of a slave."""
    for _, end in network_sockets():
        end.setsockopt(SOL_SOCKET, SO_LINGER, DO_NOT_LINGER)


def cut(pairs: Collection[tuple[int, int]]) -> None:
    """Shut down this process's connections with these pairs of ports (ours, theirs); the peer reconnects."""
    for pair, end in network_sockets():
        if pair in pairs:
            with suppress(OSError):  # it has just been closed
                end.shutdown(SHUT_RDWR)


def limit_send_buffers(pairs: Collection[tuple[int, int]]) -> None:
    """Set the usual, small send buffer on this process's connections with these pairs of ports (ours, theirs)."""
    if not pairs:
        return
    for pair, end in network_sockets():
        if pair in pairs:
            end.setsockopt(SOL_SOCKET, SO_SNDBUF, SEND_BUFFER)


def shorten_queues() -> int:
    """Limit the queue of each listening socket of this process to one connection; return the number of sockets.

    The library accepts all waiting connections, then rejects those without a TLS handshake one by one, with a pause of
    100 ms after each (eclipse-zenoh/zenoh#2685). A client without a certificate can open a thousand within seconds, and
    so lock everybody out for two minutes and occupy a thousand descriptors. With a queue of one, no more arrive in a
    pause than are rejected after it. A second listen(2) on a duplicated descriptor changes the queue of the first.
    """
    shortened = 0
    for _, end in network_sockets():
        if end.getsockopt(SOL_SOCKET, SO_ACCEPTCONN) == 1:
            end.listen(WAITING)
            shortened += 1
    return shortened


def network_sockets() -> Iterator[tuple[tuple[int, int], socket]]:
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
