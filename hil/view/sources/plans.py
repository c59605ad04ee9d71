"""Receive the paths that other masters' planners publish.

A slave forwards these paths only to clients, not to other masters. So there is a client session for each endpoint.
"""

import threading
from collections.abc import Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from hil.common.errors import NetworkError
from hil.network.roles import open_client_session
from hil.network.security import Security
from hil.network.settings import Network
from hil.ros import dialect
from hil.ros.plan import decode_plan

if TYPE_CHECKING:
    from hil.network.session import Session

RETRY_S = 0.5
PATIENCE_S = 3600.0  # longest duration of one attempt to connect; another follows
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
        session: Session | None = None
        while session is None and not self._closing.is_set():
            with suppress(NetworkError):
                session = open_client_session(endpoint, self._network, self._security, PATIENCE_S, self._pause)
        if session is None:
            return
        session.subscribe_keys(f"{dialect.domain()}/*/plan/*/*", self._on_plan, QUEUE)
        self._closing.wait()
        session.close()

    def _pause(self) -> None:
        """Wait between two attempts. Raises NetworkError when this is closed."""
        if self._closing.wait(RETRY_S):
            raise NetworkError("the view ends")

    def _on_plan(self, key: str, payload: bytes, _attachment: bytes) -> None:
        plan = decode_plan(payload)
        if plan is not None:
            self.latest[key.split("/")[1]] = plan
