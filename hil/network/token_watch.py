"""Watch liveliness tokens across the library's sessions, when one replaces another."""

import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import zenoh

if TYPE_CHECKING:
    from hil.network.reception import ReaderThread

CONFIRM_WITHIN_S = 3.0  # a new session has a link by then, and has reported all tokens that exist


class TokenWatch:
    """Call `deliver(key, alive)` for each token of others on `keys`, in the thread of `worker`.

    A new session of the library reports the tokens that exist, but not those that were withdrawn while there was no
    session. Tokens that it has not reported after CONFIRM_WITHIN_S are delivered as withdrawn.
    """

    def __init__(self, keys: str, deliver: Callable[[str, bool], None], worker: "ReaderThread") -> None:
        self._keys, self._deliver = keys, deliver
        self._alive: set[str] = set()
        self._unconfirmed: set[str] = set()  # those of `_alive` that only an earlier session has reported
        self._declarations = 0
        # Samples, the number of the declaration that has timed out, and None when another one begins, in this order.
        self._queue = worker.open_queue(self._handle)

    def declare(self, session: zenoh.Session) -> Any:
        """Declare the watch on a session of the library; return the library's object."""
        self._declarations += 1
        if self._declarations > 1:
            self._queue.put(None)
            timer = threading.Timer(CONFIRM_WITHIN_S, self._queue.put, (self._declarations,))
            timer.daemon = True
            timer.start()
        return session.liveliness().declare_subscriber(self._keys, self._queue.callback, history=True)

    def _handle(self, item: zenoh.Sample | int | None) -> None:
        if item is None:
            self._unconfirmed = set(self._alive)
        elif isinstance(item, int):
            self._on_timeout(item)
        else:
            key, alive = str(item.key_expr), item.kind == zenoh.SampleKind.PUT
            self._unconfirmed.discard(key)
            (self._alive.add if alive else self._alive.discard)(key)
            self._deliver(key, alive)

    def _on_timeout(self, declarations: int) -> None:
        if declarations != self._declarations:  # a still newer session has its own timeout
            return
        lost, self._unconfirmed = self._unconfirmed, set()
        self._alive -= lost
        for key in sorted(lost):
            self._deliver(key, False)
