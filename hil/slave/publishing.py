"""The thread that publishes for the real-time loop, which never calls the network itself.

The library's routing lock can hold a publishing thread for a second, as when a peer that had declared thousands of
subscriptions leaves. So the loop only appends calls, with references to its samples, to a bounded ring.
"""

import threading
from collections import deque
from collections.abc import Callable
from typing import Any

DEPTH = 1024  # calls that may wait: three seconds of the usual sensors
RECORDED_DEPTH = 16 * DEPTH  # of a slave that records itself: a recording with gaps cannot be repeated
CLOSE_WITHIN_S = 1.0

Call = Callable[..., None]


class PublishingThread:
    """Make calls in the order in which they were appended, in a thread of its own.

    At most `depth` wait; beyond it the oldest are dropped, and counted in `dropped`. What a call raises ends the
    thread, and is raised by the next `wake`.
    """

    def __init__(self, depth: int = DEPTH) -> None:
        self._waiting: deque[tuple[Call, tuple[Any, ...]]] = deque(maxlen=depth)  # its append and popleft are atomic
        self._idle = threading.Lock()  # locked while nobody has woken the thread since it looked last
        self._idle.acquire()
        self._closing = False
        self._failure: Exception | None = None
        self.dropped = 0
        self._thread = threading.Thread(target=self._run, name="publisher", daemon=True)
        self._thread.start()

    def append(self, call: Call, *arguments: Any) -> None:
        """Let `call(*arguments)` be made after the next `wake`. Never waits."""
        waiting = self._waiting
        if len(waiting) == waiting.maxlen:
            self.dropped += 1
        waiting.append((call, arguments))

    def wake(self) -> None:
        """Let the thread make what waits. From one thread: once a step of the loop, as each wake-up costs time.

        Raises what a call has raised.
        """
        if self._waiting and self._idle.locked():
            self._idle.release()
        if self._failure:
            raise self._failure

    def close(self) -> None:
        """End the thread once it has made what waits, or after CLOSE_WITHIN_S. The loop must have ended."""
        self._closing = True
        if self._idle.locked():
            self._idle.release()
        self._thread.join(CLOSE_WITHIN_S)

    def _run(self) -> None:
        waiting, wait = self._waiting, self._idle.acquire
        try:
            while not self._closing:
                wait()
                while waiting:
                    call, arguments = waiting.popleft()
                    call(*arguments)
        except Exception as error:  # noqa: BLE001 - whatever it is, the loop ends with it
            self._failure = error
