"""Where commands arrive: decoded in the reader's thread, judged for age and right, handed to the loop at once.

A vehicle obeys one master at a time: the first whose command comes, until it leaves or is silent for the deadman's
time. Another is refused meanwhile, unless it has a higher rank: then it takes over, and the former is refused. Nodes of
ROS 2, which do not say who they are, count as one master as long as each keeps to topics of its own.
"""

import os
import threading
import time
from collections import deque
from typing import TYPE_CHECKING, Any

from hil.autonomy.control import VelocityCommand
from hil.clock import NS_PER_S, now_ns, to_wall_ns
from hil.topics import COMMANDS
from hil.transport import ros

if TYPE_CHECKING:
    from hil.slave.orders import Orders, PoseOrder, ThrustOrder, WrenchOrder
    from hil.transport.clock_offset import ClockOffset

    Command = VelocityCommand | PoseOrder | WrenchOrder | ThrustOrder

_DRIFT_PER_S = 50_000  # ns: how fast two clocks may run apart (50 ppm)
_MOST_SENDERS = 64  # whose sequence numbers are remembered, topic by topic
_MOST_SPEED = 100.0  # m/s and rad/s: what asks for more is not meant
_BURST_S = 0.1  # how long commands may come faster than their limit


class Received:
    """A command and the instants of its way: `published_ns` by the master's wall clock, the others by ours."""

    __slots__ = ("command", "published_ns", "received_ns", "sequence")

    def __init__(self, command: "Command", sequence: int, published_ns: int, received_ns: int) -> None:
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
            grown = (received_wall_ns - self._last) * _DRIFT_PER_S // NS_PER_S
            self._least = min(self._least + grown, difference)
        self._last = received_wall_ns
        return difference - self._least


class _Sender:
    """What is remembered of one who commands, on one topic."""

    __slots__ = ("ages", "sequence")

    def __init__(self) -> None:
        self.sequence = 0
        self.ages = AgeFilter()


class Inbox:
    """Holds the newest command; `fileno` becomes readable when there is one.

    `clocks` and `ranks`, by sender, are filled in by `hil.slave.contacts`; a sender without them (a ROS 2 node) is
    judged by its fastest message and has rank 0. `master` is who is obeyed, b"" at first; `news` is set when that
    changes. `thrusters` is how many the vehicle has.

    Counts what it drops: `malformed`, `stale` (older than the limit), `disordered` (overtaken by a newer one of the
    same sender), `refused` (another master is obeyed), `flooded` (times the rate was above its limit, when the
    reader rests and the network keeps but the newest) and `superseded` (replaced before the loop took it).
    """

    def __init__(
        self,
        age_limit_ns: int,
        hold_ns: int = NS_PER_S // 2,
        rate: float = 200.0,
        thrusters: int = 0,
        news: threading.Event | None = None,
    ) -> None:
        self._age_limit_ns = age_limit_ns
        self._hold_ns = hold_ns
        self._period_ns = round(NS_PER_S / rate)
        self._event = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._newest: deque[Received] = deque(maxlen=1)  # its append and popleft are atomic
        self._senders: dict[tuple[bytes, str], _Sender] = {}
        self._strangers: dict[str, tuple[bytes, int]] = {}  # by topic who commands together, and was heard when
        self.thrusters = thrusters
        self._orders: Orders | None = None
        self._obeyed_ns = 0
        self._allowed_ns = 0  # by when as many commands as have come may have come
        self.clocks: dict[bytes, ClockOffset] = {}
        self.ranks: dict[bytes, int] = {}
        self.master = b""
        self.news = news or threading.Event()
        self.received = 0
        self.malformed = 0
        self.stale = 0
        self.disordered = 0
        self.refused = 0
        self.flooded = 0
        self.superseded = 0

    def fileno(self) -> int:
        """The descriptor that becomes readable when a command is waiting."""
        return self._event

    @property
    def fault(self) -> str:
        """What was wrong with the last command that could be read and yet not be obeyed; "" if there was none."""
        return self._orders.fault if self._orders else ""

    def deliver(self, topic: str, payload: bytes, attachment: bytes) -> None:
        """Take in one message; called in the reader's thread."""
        received_ns = now_ns()
        self.received += 1
        value = read_velocity(payload) if topic == "cmd_vel" else self._read(topic, payload)
        stamp = ros.unpack_attachment(attachment)
        if value is None or stamp is None:
            self.malformed += 1
        elif self._is_new(topic, *stamp, received_ns) and self._may_command(topic, stamp.gid, received_ns):
            command = self._orders.combine(topic, value, received_ns) if self._orders else value
            self.superseded += len(self._newest)
            self._newest.append(Received(command, stamp.sequence, stamp.time_ns, received_ns))
            os.eventfd_write(self._event, 1)
        self._rest(received_ns)

    def take(self) -> Received | None:
        """The newest command not yet taken; None if there is none, or it has become old while nobody took it."""
        try:
            os.eventfd_read(self._event)
            newest = self._newest.popleft()
        except (BlockingIOError, IndexError):  # nothing came, or it was taken with the one before
            return None
        if now_ns() - newest.received_ns > self._age_limit_ns:  # the process was stopped
            self.stale += 1
            return None
        return newest

    @property
    def silent(self) -> bool:
        """Whether the master that is obeyed has not been heard for so long that any other may command."""
        return now_ns() - self._obeyed_ns > self._hold_ns

    def forget(self, sender: bytes) -> None:
        """A master has left: another may command at once."""
        self.ranks.pop(sender, None)
        self.clocks.pop(sender, None)
        if sender == self.master:
            self.master = b""
            self.news.set()

    def close(self) -> None:
        """Give the descriptor back. The reader must have ended."""
        os.close(self._event)

    def _read(self, topic: str, payload: bytes) -> Any:
        """What a message on another topic than cmd_vel says; None if that cannot be obeyed."""
        if topic not in COMMANDS:
            return None
        if self._orders is None:
            from hil.slave.orders import Orders  # most runs do without

            self._orders = Orders(self.thrusters, self._hold_ns)
        return self._orders.read(topic, payload)

    def _is_new(self, topic: str, sequence: int, published_ns: int, sender: bytes, received_ns: int) -> bool:
        known = self._senders.get((sender, topic))
        if known is None:
            if len(self._senders) >= _MOST_SENDERS:
                del self._senders[next(iter(self._senders))]
            known = self._senders[sender, topic] = _Sender()
        if sequence <= known.sequence:
            self.disordered += 1
            return False
        known.sequence = sequence
        received_wall_ns = to_wall_ns(received_ns)
        clock = self.clocks.get(sender)
        estimate = clock.at(received_wall_ns) if clock else None
        if estimate:
            age_ns = received_wall_ns + estimate.offset_ns - published_ns
        else:
            age_ns = known.ages.age_ns(published_ns, received_wall_ns)
        if age_ns > self._age_limit_ns:
            self.stale += 1
            return False
        return True

    def _may_command(self, topic: str, sender: bytes, now: int) -> bool:
        if not self._is_obeyed(topic, sender, now):
            if self.master and not self.silent and self.ranks.get(sender, 0) <= self.ranks.get(self.master, 0):
                self.refused += 1
                return False
            self.master = sender
            self.news.set()
            self._strangers.clear()
            if self._orders:
                self._orders.forget()
        if sender not in self.ranks:
            self._strangers[topic] = sender, now
        self._obeyed_ns = now
        return True

    def _is_obeyed(self, topic: str, sender: bytes, now: int) -> bool:
        """Whether it is the master; or one of those without presence who are it together, each on its topics."""
        if not self._strangers or sender in self.ranks or self.master in self.ranks:
            return sender == self.master
        other, heard = self._strangers.get(topic, (sender, 0))
        return other == sender or now - heard > self._hold_ns

    def _rest(self, now: int) -> None:
        """Let the reader sleep when more comes than may: the network's ring then drops all but the newest."""
        self._allowed_ns = max(self._allowed_ns + self._period_ns, now - round(_BURST_S * NS_PER_S))
        if self._allowed_ns > now:
            self.flooded += 1
            time.sleep((self._allowed_ns - now) / NS_PER_S)


def read_velocity(payload: bytes) -> VelocityCommand | None:
    """What a message on cmd_vel asks for; None if that cannot be meant."""
    twist = ros.decode_twist(payload)
    if twist is None:
        return None
    (surge, sway, heave), (p, q, r) = twist
    if max(surge, sway, heave, p, q, r) > _MOST_SPEED or min(surge, sway, heave, p, q, r) < -_MOST_SPEED:
        return None
    return VelocityCommand(surge, sway, heave, r)
