"""An asyncio.Event that other threads may set, for viser.

viser's buffers of messages set their event from whatever thread draws, and afterwards once more in the loop's own.
asyncio.Event is not made for that: while the first goes through those that wait, the loop adds one, and the drawing
thread gets a RuntimeError. The more browsers look, the sooner.
"""

import asyncio
import threading


class ThreadSafeEvent(asyncio.Event):
    """Wakes those who wait only when it is set in the thread of its `loop`; elsewhere it only counts as set."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        super().__init__()
        self._loop_of_waiters = loop

    def set(self) -> None:
        """Set it. Outside the loop's thread, `loop.call_soon_threadsafe(event.set)` has to follow."""
        self._value = True
        if threading.get_ident() == getattr(self._loop_of_waiters, "_thread_id", None):
            for waiter in list(self._waiters):
                if not waiter.done():
                    waiter.set_result(True)
