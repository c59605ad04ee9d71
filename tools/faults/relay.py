"""A network between slave and master, in this process: relays the two TCP links, and fails on request."""

import select
import socket
import threading
import time
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from types import TracebackType
from typing import TYPE_CHECKING, Literal

from hil.common.ports import free_ports

if TYPE_CHECKING:
    from typing_extensions import Self

PIECE = 4096  # bytes that pass at a time if the rate is limited
LAG_S = 0.02  # lateness of a wake-up that is made up for


class Relay:
    """Listens on `port` and the next, relays to `target` and the next. Use as a context.

    `hold` stops all data without loss: `release` delivers what the sender's kernel accepted, like TCP after an outage.
    `cut` ends all connections and refuses new ones until `accept_again`. `rate` limits the bytes a second from the
    target over the links `slow`, by default the second one, which has no commands; little is buffered, like at a near
    bottleneck. `passed` counts the bytes of both directions. `blocked`: data from the target, or to it, are discarded.
    `delay_s`: all data are delayed by this time.
    """

    passed = 0
    delay_s = 0.0
    blocked: Literal["", "from target", "to target"] = ""

    def __init__(self, target: int, rate: float = 0.0, slow: Sequence[int] = (1,)) -> None:
        self.port = free_ports(1)[0]
        self._target = target
        self._rate, self._slow_links = rate, slow
        self._slow: set[socket.socket] = set()  # the ends with this rate
        self._due = 0.0  # when they may send more
        self._listeners = [socket.create_server(("127.0.0.1", self.port + link), backlog=64) for link in (0, 1)]
        self._pairs: dict[socket.socket, socket.socket] = {}
        self._far: set[socket.socket] = set()  # the ends at the target
        self._waiting: deque[tuple[float, socket.socket, bytes]] = deque()  # time, receiver, data
        self._held = False
        self._cut = False
        self._ending = False
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def __enter__(self) -> "Self":
        return self

    def __exit__(self, _: type[BaseException] | None, __: BaseException | None, ___: TracebackType | None) -> None:
        self._ending = True
        self._thread.join()
        for end in (*self._listeners, *self._pairs):
            end.close()

    @property
    def endpoint(self) -> str:
        """Endpoint to which a master connects."""
        return f"tcp/127.0.0.1:{self.port}"

    def hold(self) -> None:
        """Hold all data from now on."""
        self._held = True

    def release(self) -> None:
        """Forward what was held, and all that follows."""
        self._held = False

    def cut(self) -> None:
        """Close all connections."""
        self._cut = True

    def accept_again(self) -> None:
        """Accept new connections again."""
        self._cut = False

    def _run(self) -> None:
        while not self._ending:
            if self._cut:
                self._close(*self._pairs)
            self._deliver_delayed()
            for end in select.select([*self._listeners, *self._passing()], (), (), 0.005)[0]:
                if end in self._listeners:
                    self._accept(end)
                elif end in self._pairs:
                    self._pass(end)

    def _passing(self) -> list[socket.socket]:
        """Return the ends from which something may pass now."""
        if self._held:
            return []
        resting = self._slow if time.monotonic() < self._due else ()
        return [end for end in self._pairs if end not in resting]

    def _accept(self, listener: socket.socket) -> None:
        near, _ = listener.accept()
        if self._cut:
            near.close()
            return
        link, far = self._listeners.index(listener), socket.socket()
        if self._rate and link in self._slow_links:
            far.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2 * PIECE)
            self._slow.add(far)
        try:
            far.connect(("127.0.0.1", self._target + link))
        except OSError:
            self._close(near, far)
            return
        for end in (near, far):
            end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._pairs |= {near: far, far: near}
        self._far.add(far)

    def _pass(self, end: socket.socket) -> None:
        try:
            data = end.recv(PIECE if end in self._slow else 65536)
            if data:
                if self.blocked == ("from target" if end in self._far else "to target"):
                    return
                if self.delay_s or self._waiting:
                    self._waiting.append((time.monotonic() + self.delay_s, self._pairs[end], data))
                    return
                self._pairs[end].sendall(data)
                self.passed += len(data)
                if end in self._slow:
                    self._due = max(self._due, time.monotonic() - LAG_S) + len(data) / self._rate
                return
        except OSError:
            pass
        self._close(end, self._pairs[end])

    def _deliver_delayed(self) -> None:
        """Forward the data whose delay is over, in the order in which it came."""
        while self._waiting and self._waiting[0][0] <= time.monotonic():
            _, end, data = self._waiting.popleft()
            if end in self._pairs:
                with suppress(OSError):  # the reader has closed it, which reading reports too
                    end.sendall(data)
                    self.passed += len(data)

    def _close(self, *ends: socket.socket) -> None:
        for end in ends:
            self._pairs.pop(end, None)
            self._slow.discard(end)
            self._far.discard(end)
            end.close()
