"""The thread that publishes for the real-time loop, which never calls the network itself.

The network library's routing lock can block a publishing thread for a second, for example when a peer with thousands
of subscriptions leaves. So the loop only appends calls, with references to its samples, to a bounded queue.
"""

import threading
from collections import deque
from collections.abc import Callable
from typing import Any

DEPTH = 1024  # calls that may wait: about 3 s of the default sensors
RECORDED_DEPTH = 16 * DEPTH  # for a slave that records itself: a run cannot be repeated from a recording with gaps
CLOSE_WITHIN_S = 1.0

Call = Callable[..., None]


class PublishingThread:
    """Make calls in the order in which they were appended, in a separate thread.

    At most `depth` calls wait; beyond it the oldest are dropped and counted in `dropped`. If a call raises an
    exception, the thread ends and the next `wake` raises it.
    """

    def __init__(self, depth: int = DEPTH) -> None:
        self._waiting: deque[tuple[Call, tuple[Any, ...]]] = deque(maxlen=depth)  # its append and popleft are atomic
        self._idle = threading.Lock()  # released to wake the thread, which acquires it to wait
        self._idle.acquire()
        self._closing = False
        self._failure: Exception | None = None
        self.dropped = 0
        self._thread = threading.Thread(target=self._run, name="publisher", daemon=True)
        self._thread.start()

    def append(self, call: Call, *arguments: Any) -> None:
        """Add `call(*arguments)`, to be made after the next `wake`. Never waits."""
        waiting = self._waiting
        if len(waiting) == waiting.maxlen:
            self.dropped += 1
        waiting.append((call, arguments))

    def wake(self) -> None:
        """Let the thread make the waiting calls. Use from one thread, once a step, as each wake-up costs time.

        Raises the exception that a call has raised.
        """
        if self._waiting and self._idle.locked():
            self._idle.release()
        if self._failure:
            raise self._failure

    def close(self) -> None:
        """Wait up to CLOSE_WITHIN_S for the waiting calls, and end the thread. The loop must have ended."""
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
        except Exception as error:  # noqa: BLE001 - any error has to end the loop
            self._failure = error
