"""One thread for all that comes seldom: pings, presence, links, questions for what was said last.

A thread that waits in a channel of the library is woken ten times a second, to look for signals; three of them cost a
vehicle a thousandth of a processor. So here the library's own threads only queue what comes, and ours waits without
end. Loaded when there is something to wait for.
"""

import sys
import threading
from _queue import SimpleQueue  # the whole module loads threads and heaps
from collections.abc import Callable
from contextlib import suppress
from math import inf
from typing import Any

import zenoh

from hil.clock import NS_PER_S, now_ns

Errand = tuple[Callable[[Any], None], Any]


class Door:
    """Lets items in for `use`, no more than `rate` in a second, while fewer than `most` wait; `lost` counts the others.

    The first of each second are let in, not one after each pause: so who comes at times gets in beside a crowd that
    is not much above the rate.
    """

    def __init__(
        self, waiting: "SimpleQueue[Errand | None]", use: Callable[[Any], None], most: float, rate: float
    ) -> None:
        self._waiting, self._use, self._most, self._rate = waiting, use, most, rate
        self._second_ns = 0  # when it began,
        self._left = rate  # and how many may still come in it
        self.lost = 0

    @property
    def handler(self) -> "zenoh.handlers.Callback[Any]":
        """What to declare something with that shall come in here."""
        return zenoh.handlers.Callback(self.take, indirect=False)  # called in a thread of the library

    def take(self, item: Any) -> None:
        """Called in a thread of the library, which a flood must not keep busy."""
        now = now_ns()
        if now - self._second_ns >= NS_PER_S:
            self._second_ns, self._left = now, self._rate
        if self._left < 1 or self._waiting.qsize() >= self._most:
            self.lost += 1
        else:
            self._left -= 1
            self._waiting.put((self._use, item))


class Errands:
    """Uses what was queued, one after the other, in the thread that calls `run`.

    A `use` that raises loses its item and nothing else; `failures` counts them, the first of each kind is told.
    """

    def __init__(self) -> None:
        self._waiting: SimpleQueue[Errand | None] = SimpleQueue()
        self._told: set[type[Exception]] = set()
        self.failures = 0

    def handler(self, use: Callable[[Any], None], most: float) -> "zenoh.handlers.Callback[Any]":
        """What to declare something with, so that `use` sees each item of it; what comes while `most` wait is lost."""
        return self.door(use, most).handler

    def queue(self, use: Callable[[Any], None], most: float) -> Callable[[Any], None]:
        """What takes an item that `use` shall see; while `most` wait it is lost."""
        return self.door(use, most).take

    def door(self, use: Callable[[Any], None], most: float, rate: float = inf) -> Door:
        """The same, which also counts what is lost, and loses what comes beyond `rate` in a second."""
        return Door(self._waiting, use, most, rate)

    def run(self) -> None:
        """Until `end` is called."""
        while errand := self._waiting.get():
            use, item = errand
            try:
                use(item)
            except Exception as error:  # noqa: BLE001 - of whatever it is, others still need the thread
                self._fail(error)

    def end(self) -> None:
        """Let `run` return once it has used what waits."""
        self._waiting.put(None)

    def _fail(self, error: Exception) -> None:
        """Tell it as if the thread had ended of it."""
        self.failures += 1
        if type(error) not in self._told:
            self._told.add(type(error))
            with suppress(OSError):  # the terminal has gone
                threading.excepthook(threading.ExceptHookArgs((*sys.exc_info(), threading.current_thread())))
