"""Iterate over the samples of one sensor, with `for` and with `async for`."""

import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import Any

POLL_S = 0.1  # period at which a waiting iteration checks whether the vehicle is still present


class Stream:
    """Yield each sample from now on. At most `depth` wait; beyond it the oldest are discarded and counted in `dropped`.

    While no sample comes, `check` is called with the seconds waited; it raises if none can come any more.
    """

    def __init__(self, check: Callable[[float], None], depth: int) -> None:
        self._check = check
        self._waiting: deque[Any] = deque(maxlen=depth)
        self._changed = threading.Condition()
        self._wake_loop: Callable[[], object] = bool  # wakes an asyncio loop that waits; `bool` does nothing
        self._closed = False
        self.dropped = 0

    def put(self, sample: Any) -> None:
        """Add a sample."""
        with self._changed:
            self.dropped += len(self._waiting) == self._waiting.maxlen
            self._waiting.append(sample)
            self._changed.notify()
        self._wake_loop()

    def close(self) -> None:
        """End the iteration after the samples that are waiting."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        self._wake_loop()

    def __iter__(self) -> "Stream":
        return self

    def __next__(self) -> Any:
        began = time.monotonic()
        while not self._waiting:
            if self._closed:
                raise StopIteration
            with self._changed:
                self._changed.wait_for(self._ready, POLL_S)
            if not self._ready():
                self._check(time.monotonic() - began)
        return self._waiting.popleft()

    def __aiter__(self) -> "Stream":
        return self

    async def __anext__(self) -> Any:
        import asyncio  # already imported by a program that uses `async for`

        began, loop, event = time.monotonic(), asyncio.get_running_loop(), asyncio.Event()

        def wake_loop() -> None:
            with suppress(RuntimeError):  # the asyncio loop has ended
                loop.call_soon_threadsafe(event.set)

        self._wake_loop = wake_loop
        try:
            while not self._waiting:
                if self._closed:
                    raise StopAsyncIteration
                try:
                    await asyncio.wait_for(event.wait(), POLL_S)
                except TimeoutError:
                    self._check(time.monotonic() - began)
        finally:
            self._wake_loop = bool
        return self._waiting.popleft()

    def _ready(self) -> bool:
        return bool(self._waiting) or self._closed
