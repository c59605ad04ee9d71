"""Bounded queues for what is rare: pings, presence, matching listeners, queries for the last message.

The library's threads put items into them by direct callbacks, and one thread of ours waits for them without a timeout.
A thread that waits in a channel of the library wakes ten times a second to check for signals; three such threads cost a
vehicle a thousandth of a processor. Loaded on first use.
"""

import sys
import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from math import inf
from queue import SimpleQueue
from typing import Any

import zenoh

from hil.common.clock import NS_PER_S, now_ns
from hil.network.workarounds.exit_hang import direct_callback


class MessageQueue:
    """At most `depth` items that wait (None: any number); beyond it the oldest are dropped.

    At most `rate` items a second are accepted: the first of each second, without a pause between them, so that a sender
    of few items gets through beside one slightly above the limit. `lost` counts dropped items. `wake` is called when
    an item was added and no earlier call has been followed by `take_first` or `take_all`.
    """

    def __init__(self, wake: Callable[[], object], depth: int | None = None, rate: float = inf) -> None:
        self._wake, self._rate = wake, rate
        self._items: deque[Any] = deque(maxlen=depth)  # its append and popleft are atomic
        self._is_announced = False
        self._second_ns = 0  # when the current second began
        self._left = rate  # how many items are still accepted in it
        self.lost = 0

    @property
    def callback(self) -> "zenoh.handlers.Callback[Any]":
        """Handler for a declaration of the library, which puts the items into this queue in the library's thread."""
        return direct_callback(self.put)

    def put(self, item: Any) -> None:
        """Add an item, or count it as lost. Never waits: a flood must not keep the library's thread busy."""
        if self._rate < inf and not self._is_within_rate():
            self.lost += 1
            return
        self.lost += len(self._items) == self._items.maxlen
        self._items.append(item)
        if not self._is_announced:
            self._is_announced = True
            self._wake()

    def take(self, use: Callable[[Any], None]) -> None:
        """Call `use` with each of the items that wait now, oldest first; from one thread only."""
        self._is_announced = False  # before the items are counted: a later one is announced again
        for _ in range(len(self._items)):
            use(self._items.popleft())

    def _is_within_rate(self) -> bool:
        now = now_ns()
        if now - self._second_ns >= NS_PER_S:
            self._second_ns, self._left = now, self._rate
        self._left -= 1
        return self._left >= 0


class ReaderThread:
    """Handle the items of its queues one after the other, in the thread that calls `run`.

    If a handler raises, only its item is lost. `failures` counts such items; the first error of each type is reported.
    """

    def __init__(self) -> None:
        self._ready: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
        self._reported: set[type[Exception]] = set()
        self.failures = 0

    def open_queue(self, handle: Callable[[Any], None], depth: int | None = None, rate: float = inf) -> MessageQueue:
        """Return a queue whose items go to `handle`; `depth` and `rate` as in `MessageQueue`."""

        def use(item: Any) -> None:
            try:
                handle(item)
            except Exception as error:  # noqa: BLE001 - any error: the other handlers still need the thread
                self._fail(error)

        queue = MessageQueue(lambda: self._ready.put(take), depth, rate)
        take = partial(queue.take, use)
        return queue

    def run(self) -> None:
        """Handle items until `end` is called."""
        while take := self._ready.get():
            take()

    def end(self) -> None:
        """Let `run` return after the items that are waiting now."""
        self._ready.put(None)

    def _fail(self, error: Exception) -> None:
        """Report the error as `threading` does for a thread that ends with one."""
        self.failures += 1
        if type(error) not in self._reported:
            self._reported.add(type(error))
            with suppress(OSError):  # the terminal was closed
                threading.excepthook(threading.ExceptHookArgs((*sys.exc_info(), threading.current_thread())))
