"""Who may use a web server of ours: one check of Host, Origin and token, and the limits that all of them share.

Every page in a browser can send requests to ports of the browser's machine. Such a request names the page in Origin, or
in Host, if the page's name was bound to this machine's address (DNS rebinding). Without the token both are refused.
"""

import socket
from ipaddress import ip_address
from typing import Literal, NamedTuple

MAX_CONNECTIONS = 256  # open at once
REQUEST_S = 10.0  # within which a connection must have sent a request that is admitted
LONGEST_PATH = 2048  # characters of a request's path with its query


class WebAccess(NamedTuple):
    """The rule of a server that listens at the address `listen`.

    `pages`: "none", or "own" if the server has a page of its own, whose requests name its own host in Origin. `names`:
    further names by which others reach it.
    """

    listen: str
    pages: Literal["none", "own"] = "none"
    names: tuple[str, ...] = ()

    def refusal(self, host: str, origin: str, has_token: bool = False) -> str:
        """Return why a request with these headers ("": without it) is refused, or "" if it may be served.

        A page elsewhere needs the token at a server without pages of its own, and is refused by the others. The token
        also admits any Host: a page that was bound to this machine's address cannot know it.
        """
        is_own_page = self.pages == "own" and origin.partition("://")[2] == host
        if origin and not is_own_page and not (has_token and self.pages == "none"):
            return "a web page of another origin is refused; a page needs the token that was printed at the start"
        if not has_token and not self._is_own(host):
            return "the host in this request is not this server's; use its address as it was printed at the start"
        return ""

    def _is_own(self, host: str) -> bool:
        """Return whether a Host header names this server: a loopback address, or, listening elsewhere, any address."""
        name = host.partition("]")[0][1:] if host.startswith("[") else host.partition(":")[0]
        name = name.lower().rstrip(".")
        own = socket.gethostname().lower()
        if name in ("localhost", self.listen.lower(), *[each.lower() for each in self.names]):
            return bool(name)
        is_local = _is_loopback(self.listen)
        if name in (own, own.partition(".")[0], f"{own.partition('.')[0]}.local"):
            return not is_local
        try:
            return ip_address(name).is_loopback or not is_local
        except ValueError:
            return False


def _is_loopback(address: str) -> bool:
    try:
        return ip_address(address).is_loopback
    except ValueError:
        return address == "localhost"
