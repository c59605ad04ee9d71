"""Answer programs that search for slaves and routers by multicast, by the library's protocol for that (scouting).

The library's own answers name the addresses of its start, and reach only the interfaces that had one then.
"""

import socket
import struct
from contextlib import suppress
from typing import TYPE_CHECKING

from hil.common.endpoint import split_endpoint
from hil.network.settings import Network, endpoints

if TYPE_CHECKING:
    from hil.network.session import Session

GROUP, PORT = "224.0.0.224", 7446
WAIT_S = 0.5  # for a question; then the interfaces are checked
PAUSE_S = 0.02  # after each question, so that a flood of them costs no more
# zenoh-protocol, scouting: kinds of messages, the flag of a list of locators, and the bit that asks for routers.
KIND, SCOUT, HELLO, LOCATORS, ROUTERS = 0x1F, 1, 2, 0x20, 1


def answer_searches(
    session: "Session", endpoint: str, network: Network, is_secure: bool, is_router: bool = False
) -> None:
    """Answer in a thread, until the session is closed, with the address by which each program reaches `endpoint`."""
    responder = _Responder(session.zid, endpoints(endpoint, is_secure, is_router or network.mode == "routed"))
    session.every(PAUSE_S, responder.answer, "discovery", responder.close)


class _Responder:
    def __init__(self, zid: str, links: list[str]) -> None:
        self._zid = bytes.fromhex(zid.zfill(len(zid) + len(zid) % 2))[::-1]
        self._links = [link.partition("#")[0] for link in links]
        self._host = split_endpoint(links[0].partition("?")[0].partition("#")[0])[1]
        self._interfaces: set[int] = set()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def answer(self) -> None:
        """Wait some time for a question, and answer it."""
        with suppress(OSError):  # no question, or the one that asked is out of reach
            self._join()
            data, (peer, port) = self._socket.recvfrom(64)
            if len(data) > 2 and data[0] & KIND == SCOUT and data[2] & ROUTERS:
                with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as reply:
                    reply.connect((peer, port))
                    if hello := self._hello(data[1], reply.getsockname()[0], peer):
                        reply.send(hello)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _join(self) -> None:
        """Join the group on all interfaces; they may have no address yet."""
        interfaces = {index for index, _ in socket.if_nameindex()}
        if interfaces == self._interfaces:
            return
        self._socket.close()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._socket.settimeout(WAIT_S)
        self._socket.bind((GROUP, PORT))
        for index in interfaces:
            with suppress(OSError):  # it has just gone
                group = struct.pack("=4s4si", socket.inet_aton(GROUP), bytes(4), index)
                self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group)
        self._interfaces = interfaces

    def _hello(self, version: int, own: str, peer: str) -> bytes:
        """Return the answer to `peer`, which reaches this machine at its address `own`; empty if it cannot."""
        if own != peer and (self._host in ("localhost", "[::1]") or self._host.startswith("127.")):
            return b""
        address = own if self._host in ("0.0.0.0", "[::]") else self._host
        links = [link.replace(self._host, address, 1).encode() for link in self._links]
        names = b"".join([_number(len(link)) + link for link in links])
        head = bytes([HELLO | LOCATORS, version, (len(self._zid) - 1) << 4])
        return head + self._zid + _number(len(links)) + names


def _number(value: int) -> bytes:
    """Return a number of the library's protocol: seven bits a byte, the lowest first."""
    return bytes([value]) if value < 0x80 else bytes([value & 0x7F | 0x80]) + _number(value >> 7)
