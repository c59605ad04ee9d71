"""Listen at an address that this machine does not have yet, and again when it comes back."""

import errno
import logging
import socket
import sys

FREEBIND = {socket.AF_INET: (socket.IPPROTO_IP, 15), socket.AF_INET6: (socket.IPPROTO_IPV6, 78)}  # linux/in.h, in6.h
QUEUE = 128  # connections that wait to be accepted


def late_socket(host: str, port: int) -> socket.socket | None:
    """Return a listening socket if `host` is an address that is not there yet, which is logged; None otherwise.

    Connections come once the address is there. Only Linux can do that: elsewhere None is returned.
    """
    if sys.platform != "linux" or not host:
        return None
    family, kind, _, _, where = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    opened = socket.socket(family, kind)
    try:
        opened.bind((where[0], 0))
    except OSError as error:
        if error.errno == errno.EADDRNOTAVAIL:
            opened.setsockopt(*FREEBIND[family], 1)
            opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            opened.bind(where)
            opened.listen(QUEUE)
            logging.getLogger(__name__).warning(
                "%s:%d: waiting for it: this machine does not have that address yet", host, port
            )
            return opened
    opened.close()
    return None
