"""python-can's virtual bus with a descriptor to wait on.

With it a sender can read the answer at once, without a thread that has to wake up. Other software in this process uses
it like any virtual bus.
"""

import os
import queue
import time

from can import CanOperationError, Message
from can.interfaces import virtual

Messages = queue.Queue[Message]


class BelledQueue(Messages):
    """Queue whose `fd` is readable while it is not empty. Raises queue.Full and queue.Empty like any queue."""

    def __init__(self, most: int) -> None:
        super().__init__(most)
        self.fd = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)

    def close(self) -> None:
        """Close the descriptor. A sender that still has this queue may use it, without effect."""
        with self.mutex:
            fd, self.fd = self.fd, -1
            if fd >= 0:
                os.close(fd)

    def _put(self, item: Message) -> None:  # the mutex is held here and in `_get`
        if self.fd >= 0 and not self._qsize():
            os.eventfd_write(self.fd, 1)
        super()._put(item)

    def _get(self) -> Message:
        item: Message = super()._get()
        if self.fd >= 0 and not self._qsize():
            os.eventfd_read(self.fd)
        return item


class VirtualBus(virtual.VirtualBus):
    """One end of the virtual bus `channel` of this process; at most `most_frames` frames wait to be read."""

    def __init__(self, channel: str, most_frames: int) -> None:
        super().__init__(channel)
        self._waiting = BelledQueue(most_frames)
        with virtual.channels_lock:
            self.channel[self.channel.index(self.queue)] = self.queue = self._waiting

    def fileno(self) -> int:
        """Return the descriptor to wait on for frames."""
        return self._waiting.fd

    def send(self, msg: Message, timeout: float | None = None) -> None:
        """Send a data frame to all other ends, as a simple copy each; python-can's deep copies take most of its time.

        Raises CanOperationError if one of them does not read within `timeout` (s).
        """
        self._check_if_open()
        now = time.time()
        for other in self.channel:
            if other is not self.queue:
                copy = Message(
                    now, msg.arbitration_id, msg.is_extended_id, channel=self.channel_id, data=bytes(msg.data)
                )
                try:
                    other.put(copy, timeout=timeout)
                except queue.Full:
                    raise CanOperationError("an end of the bus does not read") from None

    def shutdown(self) -> None:
        """Leave the bus. May be called twice."""
        super().shutdown()
        self._waiting.close()
