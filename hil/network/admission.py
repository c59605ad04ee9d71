"""Let few connections wait at a TLS listener.

The library accepts all connections that wait, and then fails those without a handshake one by one, with a pause of
100 ms after each (eclipse-zenoh/zenoh#2685): a thousand of them, which take a client without a certificate some
seconds, keep everybody out for two minutes and hold a thousand descriptors. What the kernel lets wait is ours to say:
with a queue of one the library gets no more of them in a pause than it fails behind it.
"""

import os
from _socket import AF_INET, AF_INET6, SO_ACCEPTCONN, SOL_SOCKET, socket  # the whole module costs a slave 7 ms
from contextlib import suppress

WAITING = 0  # the kernel adds one


def shorten_queues() -> int:
    """Let one connection wait at each network socket on which this process listens; how many sockets that are.

    A second descriptor of a socket, and listen(2) once more, change that of the first.
    """
    shortened = 0
    for name in os.listdir("/proc/self/fd"):
        with suppress(OSError):  # the descriptor has been closed meanwhile
            if os.readlink(f"/proc/self/fd/{name}").startswith("socket:"):
                shortened += _shorten(os.dup(int(name)))
    return shortened


def _shorten(descriptor: int) -> bool:
    try:
        end = socket(fileno=descriptor)
    except OSError:  # the first was another thing's by the time of the second
        os.close(descriptor)
        return False
    try:
        is_listening = end.family in (AF_INET, AF_INET6) and end.getsockopt(SOL_SOCKET, SO_ACCEPTCONN) == 1
        if is_listening:
            end.listen(WAITING)
        return is_listening
    finally:
        end.close()
