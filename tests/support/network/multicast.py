"""Whether datagrams to a multicast group reach this machine's own sockets, as tests of buses and discovery need."""

import socket
from functools import cache

import pytest

GROUP = "239.74.163.99"


@cache
def _has_multicast() -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.settimeout(2.0)
        try:
            receiver.bind(("", 0))
            membership = socket.inet_aton(GROUP) + socket.inet_aton("0.0.0.0")
            receiver.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)
            receiver.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
            receiver.sendto(b"here", (GROUP, receiver.getsockname()[1]))
            return receiver.recv(9) == b"here"
        except OSError:
            return False


def require_multicast() -> None:
    """Skip the test where the network has no multicast, as in a network namespace with a loopback device alone."""
    if not _has_multicast():
        pytest.skip("this network has no multicast")
