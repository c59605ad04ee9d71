"""One thread for everything that is rare: pings, presence, matching listeners, queries for the last message.

A thread that waits in a channel of zenoh wakes ten times a second to look for signals; three such threads cost a
vehicle a thousandth of a processor. So zenoh's own threads only put items into queues here, and one thread of ours
waits for them without a timeout. Loaded when there is something to wait for.
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
    """Accept items for `handle`, at most `rate` per second, while fewer than `capacity` jobs wait.

    `lost` counts the items that were dropped. The first `rate` items of each second are accepted, without a pause
    between them: so a sender of few items gets through beside one whose rate is a little above the limit.
    """

    def __init__(
        self, jobs: "SimpleQueue[Job | None]", handle: Callable[[Any], None], capacity: float, rate: float
    ) -> None:
        self._jobs, self._handle, self._capacity, self._rate = jobs, handle, capacity, rate
        self._second_ns = 0  # when the current second began,
        self._left = rate  # and how many items it still accepts
        self.lost = 0

    @property
    def callback(self) -> "zenoh.handlers.Callback[Any]":
        """Handler for a zenoh declaration whose items go into this queue."""
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

    A handler that raises loses its item and nothing else. `failures` counts them; the first of each type is reported.
    """

    def __init__(self) -> None:
        self._jobs: SimpleQueue[Job | None] = SimpleQueue()
        self._reported: set[type[Exception]] = set()
        self.failures = 0

    def open_queue(self, handle: Callable[[Any], None], capacity: float = inf, rate: float = inf) -> BoundedQueue:
        """Return a queue whose items `handle` gets; items beyond `capacity` waiting or `rate` per second are lost."""
        return BoundedQueue(self._jobs, handle, capacity, rate)

    def run(self) -> None:
        """Handle items until `end` is called."""
        while job := self._jobs.get():
            handle, item = job
            try:
                handle(item)
            except Exception as error:  # noqa: BLE001 - whatever it is, the other handlers still need the thread
                self._fail(error)

    def end(self) -> None:
        """Let `run` return after the items that wait now."""
        self._jobs.put(None)

    def _fail(self, error: Exception) -> None:
        """Report the error as if the thread had ended with it."""
        self.failures += 1
        if type(error) not in self._reported:
            self._reported.add(type(error))
            with suppress(OSError):  # the terminal was closed
                threading.excepthook(threading.ExceptHookArgs((*sys.exc_info(), threading.current_thread())))
