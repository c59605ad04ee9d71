"""Where commands arrive: decoded in the reader's thread, judged for age, handed to the loop at once."""

import os
from collections import deque

from hil.autonomy.control import VelocityCommand
from hil.clock import NS_PER_S, now_ns, to_wall_ns
from hil.transport import ros

_DRIFT_PER_S = 50_000  # ns: how fast two clocks may run apart (50 ppm)


class Received:
    """A command and the instants of its way: `published_ns` by the master's wall clock, the others by ours."""

    __slots__ = ("command", "published_ns", "received_ns", "sequence")

    def __init__(self, command: VelocityCommand, sequence: int, published_ns: int, received_ns: int) -> None:
        self.command = command
        self.sequence = sequence
        self.published_ns = published_ns
        self.received_ns = received_ns


class AgeFilter:
    """How much longer than the fastest message a message was on its way, without synchronised clocks.

    The smallest difference seen between their time of sending and ours of receipt stands for zero age; it
    is let grow slowly, so that clocks which drift apart are followed.
    """

    def __init__(self) -> None:
        self._least: int | None = None
        self._last = 0

    def age_ns(self, sent_wall_ns: int, received_wall_ns: int) -> int:
        """Age of a message (ns) beyond that of the fastest one so far."""
        difference = received_wall_ns - sent_wall_ns
        if self._least is None:
            self._least = difference
        else:
            self._least += (received_wall_ns - self._last) * _DRIFT_PER_S // NS_PER_S
        self._last = received_wall_ns
        self._least = min(self._least, difference)
        return difference - self._least


class Inbox:
    """Holds the newest command; `fileno` becomes readable when there is one.

    Counts what it drops: `malformed`, `stale` (older than the limit), `disordered` (overtaken by a newer
    one of the same sender) and `superseded` (replaced before the loop took it).
    """

    def __init__(self, age_limit_ns: int) -> None:
        self._age_limit_ns = age_limit_ns
        self._event = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._newest: deque[Received] = deque(maxlen=1)  # its append and popleft are atomic
        self._sender = b""
        self._sequence = 0
        self._ages = AgeFilter()
        self.received = 0
        self.malformed = 0
        self.stale = 0
        self.disordered = 0
        self.superseded = 0

    def fileno(self) -> int:
        """The descriptor that becomes readable when a command is waiting."""
        return self._event

    def deliver(self, _topic: str, payload: bytes, attachment: bytes) -> None:
        """Take in one message; called in the reader's thread."""
        received_ns = now_ns()
        self.received += 1
        twist = ros.decode_twist(payload)
        stamp = ros.unpack_attachment(attachment)
        if twist is None or stamp is None:
            self.malformed += 1
            return
        sequence, published_ns, sender = stamp
        if sender != self._sender:
            self._sender, self._sequence, self._ages = sender, 0, AgeFilter()
        if sequence <= self._sequence:
            self.disordered += 1
            return
        self._sequence = sequence
        if self._ages.age_ns(published_ns, to_wall_ns(received_ns)) > self._age_limit_ns:
            self.stale += 1
            return
        linear, angular = twist
        command = VelocityCommand(*linear, yaw_rate=angular[2])
        self.superseded += len(self._newest)
        self._newest.append(Received(command, sequence, published_ns, received_ns))
        os.eventfd_write(self._event, 1)

    def take(self) -> Received | None:
        """The newest command not yet taken; None if there is none."""
        try:
            os.eventfd_read(self._event)
            return self._newest.popleft()
        except (BlockingIOError, IndexError):  # nothing came, or it was taken with the one before
            return None

    def close(self) -> None:
        """Give the descriptor back. The reader must have ended."""
        os.close(self._event)
