"""Handle zenoh's sockets directly: close lost links at once, cut those that are not read, limit what waits at them.

The library's sockets linger: closing one whose last bytes nobody has acknowledged blocks a thread of the library for up
to ten seconds, and that may be the one which accepts or opens the next link (eclipse-zenoh/zenoh#2350,
tokio-rs/tokio#7751). A black-out of 7 s was mended up to 14 s after its end. So linger is disabled on each link as soon
as it is there; what is on its way when a session closes is still sent, by the kernel.
"""

import os
import sys
from collections.abc import Collection, Iterator
from contextlib import suppress
from socket import AF_INET, AF_INET6, SHUT_RDWR, SO_ACCEPTCONN, SO_LINGER, SO_SNDBUF, SOL_SOCKET, socket
from struct import pack

import zenoh

from hil.network.settings import SEND_BUFFER

WAITING = 0  # connections that a listener lets wait; the kernel adds one
DO_NOT_LINGER = pack("ii", 0, 0)  # struct linger: not switched on


def free_new(link: zenoh.LinkEvent) -> None:
    """Prepare the socket of a new link."""
    if link.kind == zenoh.SampleKind.PUT:
        free_sockets()


def free_sockets() -> None:
    """Let no network socket of this process linger. A slave has about twenty descriptors: 0.1 ms."""
    for _, end in network_sockets():
        end.setsockopt(SOL_SOCKET, SO_LINGER, DO_NOT_LINGER)


def cut(pairs: Collection[tuple[int, int]]) -> None:
    """End this process's connections with these ports, ours and theirs; who dialled opens them again."""
    for pair, end in network_sockets():
        if pair in pairs:
            with suppress(OSError):  # it has just ended by itself
                end.shutdown(SHUT_RDWR)


def limit_send_buffers(pairs: Collection[tuple[int, int]]) -> None:
    """Give this process's connections with these ports, ours and theirs, the small send buffer of all others."""
    if not pairs:
        return
    for pair, end in network_sockets():
        if pair in pairs:
            end.setsockopt(SOL_SOCKET, SO_SNDBUF, SEND_BUFFER)


def shorten_queues() -> int:
    """Let one connection wait at each network socket on which this process listens; how many sockets that are.

    The library accepts all connections that wait, and then fails those without a TLS handshake one by one, with a pause
    of 100 ms after each (eclipse-zenoh/zenoh#2685): a thousand of them, which take a client without a certificate some
    seconds, keep everybody out for two minutes and hold a thousand descriptors. With a queue of one it gets no more of
    them in a pause than it fails behind it. listen(2) once more, by a second descriptor, changes that of the first.
    """
    shortened = 0
    for _, end in network_sockets():
        if end.getsockopt(SOL_SOCKET, SO_ACCEPTCONN) == 1:
            end.listen(WAITING)
            shortened += 1
    return shortened


def network_sockets() -> Iterator[tuple[tuple[int, int], socket]]:
    """Yield a second descriptor of each, by which the first can be worked on, and its ports, ours and theirs (0: none).

    What raises OSError with one, as that it has been closed meanwhile, is left to the next. Only Linux has the list.
    psutil would cost the slave's start (hil/slave/health/usage.py), and has no descriptor without an address.
    """
    if sys.platform != "linux":
        return
    for name in os.listdir("/proc/self/fd"):
        with suppress(OSError):
            if os.readlink(f"/proc/self/fd/{name}").startswith("socket:"):
                descriptor = os.dup(int(name))
                try:
                    end = socket(fileno=descriptor)
                except OSError:  # the first was another thing's by the time of the second
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
    except OSError:  # it listens
        return 0
