"""Receive the paths that other masters' planners publish.

A slave forwards these paths only to clients, not to other masters. So there is a client session for each endpoint.
"""

import threading
from collections.abc import Sequence
from typing import Any

from hil.network.presence import watch_nodes
from hil.network.roles import client_opener, open_when_present
from hil.network.security import Security
from hil.network.settings import Network
from hil.ros import dialect
from hil.ros.plan import decode_plan

QUEUE = 4


class Plans:
    """The newest plan of each vehicle at `endpoints`, which need not be reachable yet. Use as a context."""

    def __init__(self, endpoints: Sequence[str], network: Network, security: Security | None) -> None:
        self.latest: dict[str, Any] = {}
        self._network, self._security = network, security
        self._closing = threading.Event()
        self._threads = [
            threading.Thread(target=self._listen, args=(endpoint,), name=f"plans {endpoint}", daemon=True)
            for endpoint in endpoints
        ]

    def __enter__(self) -> "Plans":
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closing.set()
        for thread in self._threads:
            thread.join()

    def _listen(self, endpoint: str) -> None:
        session = open_when_present(client_opener(endpoint, self._network, self._security), self._closing)
        if session:
            watch_nodes(session)
            session.subscribe_keys(f"{dialect.domain()}/*/plan/*/*", self._on_plan, QUEUE)
            self._closing.wait()
            session.close()

    def _on_plan(self, key: str, payload: bytes, _attachment: bytes) -> None:
        plan = decode_plan(payload)
        if plan is not None:
            self.latest[key.split("/")[1]] = plan
