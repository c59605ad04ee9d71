"""Let no lost link hold up the next one.

The library's sockets linger: closing one whose last bytes nobody has acknowledged blocks a thread of the library for up
to ten seconds, and that may be the one which accepts or opens the next link (eclipse-zenoh/zenoh#2350,
tokio-rs/tokio#7751). A black-out of 7 s was mended up to 14 s after its end. So each link is told not to linger as soon
as it is there; what is on its way when a session closes is still sent, by the kernel.
"""

import os
from _socket import AF_INET, AF_INET6, SO_LINGER, SOL_SOCKET, socket  # the whole module costs a slave 7 ms
from contextlib import suppress
from struct import pack

import zenoh

DO_NOT_LINGER = pack("ii", 0, 0)  # struct linger: not switched on


def free_new(link: zenoh.LinkEvent) -> None:
    """Free a link that has come."""
    if link.kind == zenoh.SampleKind.PUT:
        free_sockets()


def free_sockets() -> None:
    """Let no network socket of this process linger. A slave has about twenty descriptors: 0.1 ms."""
    for name in os.listdir("/proc/self/fd"):
        with suppress(OSError):  # the descriptor has been closed meanwhile, or cannot linger
            if os.readlink(f"/proc/self/fd/{name}").startswith("socket:"):
                _free(os.dup(int(name)))


def _free(descriptor: int) -> None:
    """A second descriptor of a socket sets the options of the first."""
    try:
        end = socket(fileno=descriptor)
    except OSError:  # the first was another thing's by the time of the second
        os.close(descriptor)
        return
    if end.family in (AF_INET, AF_INET6):
        end.setsockopt(SOL_SOCKET, SO_LINGER, DO_NOT_LINGER)
    end.close()
