"""Handle zenoh's sockets directly: close lost links at once, and cut a link that zenoh does not read.

The library's sockets linger: closing one whose last bytes nobody has acknowledged blocks a thread of the library for up
to ten seconds, and that may be the one which accepts or opens the next link (eclipse-zenoh/zenoh#2350,
tokio-rs/tokio#7751). A black-out of 7 s was mended up to 14 s after its end. So linger is disabled on each link as soon
as it is there; what is on its way when a session closes is still sent, by the kernel.
"""

import os
import sys
from _socket import AF_INET, AF_INET6, SHUT_RDWR, SO_LINGER, SOL_SOCKET, socket  # the whole module costs a slave 7 ms
from collections.abc import Collection, Iterator
from contextlib import suppress
from struct import pack

import zenoh

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


def network_sockets() -> Iterator[tuple[tuple[int, int], socket]]:
    """Yield a second descriptor of each, by which the first can be worked on, and its ports, ours and theirs (0: none).

    What raises OSError with one, as that it has been closed meanwhile, is left to the next. Only Linux has the list.
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
