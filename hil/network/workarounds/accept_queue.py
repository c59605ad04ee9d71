"""Symptom: clients without a certificate lock everybody out for minutes, and occupy a thousand descriptors.

The library accepts all waiting connections, then rejects those without a TLS handshake one by one, with a pause of
100 ms after each. With a queue of one connection, no more arrive in a pause than are rejected after it. A second
listen(2) on a duplicated descriptor changes the queue of the first.

Report: docs/upstream/zenoh_accept.md, eclipse-zenoh/zenoh#2685. Remove when
`test_the_library_pauses_after_a_failed_handshake` fails.
"""

from socket import SO_ACCEPTCONN, SOL_SOCKET

from hil.network.sockets import network_sockets

WAITING = 0  # length of a listener's queue; the kernel adds one


def shorten_queues() -> int:
    """Limit the queue of each listening socket of this process to one connection; return the number of sockets."""
    shortened = 0
    for _, end in network_sockets():
        if end.getsockopt(SOL_SOCKET, SO_ACCEPTCONN) == 1:
            end.listen(WAITING)
            shortened += 1
    return shortened
