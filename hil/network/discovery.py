"""Find slaves and routers in the local network by multicast, those with `discovery = true` in [network].

Many access points do not forward multicast; an explicit endpoint always works.
"""

import time
from collections.abc import Callable
from typing import TYPE_CHECKING

import zenoh

from hil.common.endpoint import LAN
from hil.network.settings import json5

if TYPE_CHECKING:
    from hil.network.session import Session

POLL_S = 0.005
AGAIN_S = 1.0  # a search asks at the addresses that this machine had when it began
LOOK_S = 0.6  # duration of one search of a session; its end waits for it
LOST_S = 2.0  # without a link for so long, and again after it, a session searches
URGENT = "?prio=1-3"  # as in hil.network.settings
NOBODY = (
    "nobody answered by multicast; the slave's scenario needs discovery = true in its [network] section and an address "
    "of this network in listen; many access points block multicast: tcp/ADDRESS:PORT always works"
)


def find(seconds: float) -> list[str]:
    """Return an endpoint of each that answers within `seconds`; return earlier, soon after the first answer."""
    endpoints: dict[str, str] = {}  # zenoh id -> the first address that answered
    deadline = time.monotonic() + seconds
    while not endpoints and (left := deadline - time.monotonic()) > 0:
        _ask(endpoints, min(left, AGAIN_S))
    return sorted(set(endpoints.values()))


def _ask(endpoints: dict[str, str], seconds: float) -> None:
    config = zenoh.Config.from_json5(json5({"scouting": {"multicast": {"enabled": True}}}))
    scout = zenoh.scout(zenoh.handlers.FifoChannel(64), what="router", config=config)
    deadline = time.monotonic() + seconds
    try:
        while time.monotonic() < deadline:
            hello = scout.try_recv()
            if hello is None:
                time.sleep(POLL_S)
                continue
            urgent = [locator for locator in hello.locators if locator.endswith(URGENT)]  # first of a slave's two
            for locator in urgent or hello.locators:
                if not endpoints:
                    deadline = min(deadline, time.monotonic() + 0.1)  # for other answers to the same request
                endpoints.setdefault(str(hello.zid), locator.removesuffix(URGENT))
    finally:
        scout.stop()  # type: ignore[no-untyped-call]


class Search:
    """The addresses of a session with `endpoints`, of which one is "lan": searched, and again when links are lost."""

    def __init__(self, *endpoints: str) -> None:
        self._named = [endpoint for endpoint in endpoints if endpoint != LAN]
        self.addresses = tuple(self._named)
        self._wanted = 1
        self._due = 0.0

    def look(self) -> bool:
        """Search; return whether there is an address that was not known."""
        found = find(LOOK_S)
        is_new = not set(found) <= set(self.addresses)
        if is_new:
            self.addresses = (*self._named, *found)
            self._wanted = max(self._wanted, len(self.addresses))
        return is_new

    def watch(self, session: "Session") -> Callable[[int], None]:
        """Return a check for the session's supervisor, which searches while a link is missing."""

        def check(_: int) -> None:
            session.peer_count = self._wanted
            if session.supervisor.is_linked():
                self._due = time.monotonic() + LOST_S
            elif time.monotonic() > self._due:
                if self.look():
                    session.reopen()
                self._due = time.monotonic() + LOST_S

        return check
