"""Symptom: after an outage of 7 s a link comes back up to 14 s later.

The library's sockets linger: closing one with unacknowledged bytes blocks a thread of the library for up to 10 s. That
thread may be the one that accepts or opens the next link. So linger is disabled on each new link. The kernel still
sends what is queued when a session closes.

Report: eclipse-zenoh/zenoh#2350, tokio-rs/tokio#7751. Remove when `test_no_link_has_linger_set` fails at its first
assertion.
"""

from socket import SO_LINGER, SOL_SOCKET
from struct import pack

import zenoh

from hil.network.sockets import network_sockets

DO_NOT_LINGER = pack("ii", 0, 0)  # struct linger: off


def free_new(link: zenoh.LinkEvent) -> None:
    """Disable linger on the network sockets of this process: 0.1 ms for the about twenty descriptors of a slave."""
    if link.kind == zenoh.SampleKind.PUT:
        for _, end in network_sockets():
            end.setsockopt(SOL_SOCKET, SO_LINGER, DO_NOT_LINGER)
