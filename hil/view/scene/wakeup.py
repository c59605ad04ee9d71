"""An asyncio.Event that other threads may set, for viser.

viser sets the event of a message buffer from the thread that draws, and then again in the thread of the event loop.
asyncio.Event is not thread-safe: if the loop adds a waiter while the drawing thread iterates over the waiters, the
drawing thread gets a RuntimeError. This happens sooner with more browsers.
"""

import asyncio
import threading


class ThreadSafeEvent(asyncio.Event):
    """An event that wakes its waiters only when set in the thread of `loop`; other threads only mark it as set."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        super().__init__()
        self._loop_of_waiters = loop

    def set(self) -> None:
        """Set the event. Outside the loop's thread, `loop.call_soon_threadsafe(event.set)` must follow."""
        self._value = True
        if threading.get_ident() == getattr(self._loop_of_waiters, "_thread_id", None):
            for waiter in list(self._waiters):
                if not waiter.done():
                    waiter.set_result(True)
