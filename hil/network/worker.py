"""One thread for everything that is rare: pings, presence, matching listeners, queries for the last message.

A thread that waits in a zenoh channel wakes ten times a second to check for signals; three such threads cost a vehicle
a thousandth of a processor. So zenoh's own threads only put items into queues here, and one thread of ours waits for
them without a timeout. Loaded on first use.
"""

import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from math import inf
from queue import SimpleQueue
from typing import Any

import zenoh

from hil.common.clock import NS_PER_S, now_ns

Job = tuple[Callable[[Any], None], Any]


class BoundedQueue:
    """Accept items for `handle`, at most `rate` a second, while fewer than `capacity` jobs wait.

    `lost` counts dropped items. The first `rate` items of each second are accepted, without a pause between them, so
    that a sender of few items gets through beside one slightly above the limit.
    """

    def __init__(
        self, jobs: "SimpleQueue[Job | None]", handle: Callable[[Any], None], capacity: float, rate: float
    ) -> None:
        self._jobs, self._handle, self._capacity, self._rate = jobs, handle, capacity, rate
        self._second_ns = 0  # when the current second began
        self._left = rate  # how many items are still accepted in it
        self.lost = 0

    @property
    def callback(self) -> "zenoh.handlers.Callback[Any]":
        """Handler for a zenoh declaration, which puts the items into this queue."""
        # Called in a thread of the library.
        handler: zenoh.handlers.Callback[Any] = zenoh.handlers.Callback(self.put, indirect=False)
        return handler

    def put(self, item: Any) -> None:
        """Add an item, or count it as lost. Called in a thread of zenoh, which a flood must not keep busy."""
        now = now_ns()
        if now - self._second_ns >= NS_PER_S:
            self._second_ns, self._left = now, self._rate
        if self._left < 1 or self._jobs.qsize() >= self._capacity:
            self.lost += 1
        else:
            self._left -= 1
            self._jobs.put((self._handle, item))


class WorkerThread:
    """Handle queued items one after the other, in the thread that calls `run`.

    If a handler raises, only its item is lost. `failures` counts such items; the first error of each type is reported.
    """

    def __init__(self) -> None:
        self._jobs: SimpleQueue[Job | None] = SimpleQueue()
        self._reported: set[type[Exception]] = set()
        self.failures = 0

    def open_queue(self, handle: Callable[[Any], None], capacity: float = inf, rate: float = inf) -> BoundedQueue:
        """Return a queue whose items go to `handle`; items beyond `capacity` waiting or `rate` a second are dropped."""
        return BoundedQueue(self._jobs, handle, capacity, rate)

    def run(self) -> None:
        """Handle items until `end` is called."""
        while job := self._jobs.get():
            handle, item = job
            try:
                handle(item)
            except Exception as error:  # noqa: BLE001 - any error: the other handlers still need the thread
                self._fail(error)

    def end(self) -> None:
        """Let `run` return after the items that are waiting now."""
        self._jobs.put(None)

    def _fail(self, error: Exception) -> None:
        """Report the error as `threading` does for a thread that ends with one."""
        self.failures += 1
        if type(error) not in self._reported:
            self._reported.add(type(error))
            with suppress(OSError):  # the terminal was closed
                threading.excepthook(threading.ExceptHookArgs((*sys.exc_info(), threading.current_thread())))
