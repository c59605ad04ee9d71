"""Where commands arrive: decoded in the reader's thread, judged for age and right, handed to the loop at once.

A vehicle obeys one master at a time: the first whose command comes, until it leaves or is silent for the deadman's
time. Another is refused meanwhile, unless it has a higher rank: then it takes over, and the former is refused. Nodes of
ROS 2, which do not say who they are, count as one master as long as each keeps to topics of its own. Who is refused is
not even read, so that a flood of it costs little and neither hides the master's commands nor passes for its silence.
"""

import os
import threading
import time
from collections import deque
from typing import TYPE_CHECKING, Any

from hil.autonomy.control import VelocityCommand
from hil.clock import NS_PER_MS, NS_PER_S, now_ns, to_wall_ns
from hil.topics import COMMANDS
from hil.transport import ros

if TYPE_CHECKING:
    from hil.slave.orders import Orders, PoseOrder, ThrustOrder, WrenchOrder
    from hil.transport.clock_offset import ClockOffset

    Command = VelocityCommand | PoseOrder | WrenchOrder | ThrustOrder

_DRIFT_PER_S = 50_000  # ns: how fast two clocks may run apart (50 ppm)
_STEADY_NS = 20 * NS_PER_MS  # ages that differ by less are the same,
_AGREE_NS = NS_PER_S  # if there is one of them that often,
_STEADY_FOR_NS = 5 * NS_PER_S  # and for so long; no replay and no queue that grows or drains keeps an age like that
_MOST_SENDERS = 64  # whose sequence numbers are remembered, topic by topic
_MOST_SPEED = 100.0  # m/s and rad/s: what asks for more is not meant
_BURST_NS = 100 * NS_PER_MS  # how long commands may come faster than their limit
_CROWD = 1000.0  # a second: with more than so many that are not obeyed, what is may be lost among them
_BREATHS = 4  # how many of a crowd are passed over at a stretch: fewer than the network's ring keeps
_BREATH_S = 0.0001


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
    is let grow slowly, so that clocks which drift apart are followed. A clock that is set back makes every message
    look old, each as much as the other, which `was_set` tells from messages that are.
    """

    def __init__(self) -> None:
        self._least: int | None = None
        self._last = 0
        self._steady = 0  # the difference of those that look old,
        self._since = self._agreed = 0  # when it was first and last seen

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

    def was_set(self, sent_wall_ns: int, received_wall_ns: int, follows: bool) -> bool:
        """Whether the sender's clock makes a message look old, and not its way; if so, ages begin anew with it.

        To be asked of each that looks old; `follows`: upon the one before it, as not in a queue that is full. Old
        messages come faster than they were sent, or slower; to look equally old for seconds takes a clock.
        """
        difference = received_wall_ns - sent_wall_ns
        missed = received_wall_ns - self._agreed > _AGREE_NS
        if missed or not follows or difference < self._steady - _STEADY_NS:
            self._steady, self._since, self._agreed = difference, received_wall_ns, received_wall_ns
        elif difference <= self._steady + _STEADY_NS:
            self._agreed = received_wall_ns
            if received_wall_ns - self._since >= _STEADY_FOR_NS:
                self._least = min(self._steady, difference)
                return True
        return False


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
    changes. `thrusters` is how many the vehicle has. `fault` is what was wrong with the last command that could be read
    and yet not be obeyed; "" if there was none.

    Counts what it drops: `malformed`, `stale` (older than the limit), `disordered` (overtaken by a newer one of the
    same sender), `refused` (another master is obeyed), `flooded` (times the rate was above its limit, when the
    reader rests and the network keeps but the newest; or above that of a crowd) and `superseded` (replaced before the
    loop took it).
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
        self._crowd_ns = round(NS_PER_S / max(rate, _CROWD))
        self._passed_ns = 0  # by when as many that were not obeyed are no crowd
        self._crowded_ns = 0  # when they last were one
        self.clocks: dict[bytes, ClockOffset] = {}
        self.ranks: dict[bytes, int] = {}
        self.master = b""
        self.fault = ""
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

    def deliver(self, topic: str, payload: bytes, attachment: bytes) -> None:
        """Take in one message; called in the reader's thread."""
        received_ns = now_ns()
        self.received += 1
        stamp = ros.unpack_attachment(attachment)
        obeyed = stamp is not None and self._is_obeyed(topic, stamp.gid, received_ns)
        if stamp is None:
            self.malformed += 1
        elif not obeyed and not self._may_take_over(stamp.gid):
            self.refused += 1
        else:
            value = read_velocity(payload) if topic == "cmd_vel" else self._read(topic, payload)
            if value is None:
                self.malformed += 1
            elif self._is_new(topic, *stamp, received_ns):
                self._obey(topic, stamp.gid, obeyed, received_ns)
                command = self._orders.combine(topic, value, received_ns) if self._orders else value
                self.superseded += len(self._newest)
                self._newest.append(Received(command, stamp.sequence, stamp.time_ns, received_ns))
                os.eventfd_write(self._event, 1)
                self._rest(received_ns)
                return
        self._pass_over(received_ns)

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
        return self._is_silent(self._obeyed_ns, now_ns())

    def forget(self, sender: bytes) -> None:
        """A master has left: another may command at once."""
        self.ranks.pop(sender, None)
        self.clocks.pop(sender, None)
        if sender == self.master:
            self.master = b""
            self._strangers.clear()  # of which it was one, if it commanded before it was known
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
        self._orders.fault = ""
        value = self._orders.read(topic, payload)
        self.fault = self._orders.fault or self.fault
        return value

    def _is_new(self, topic: str, sequence: int, published_ns: int, sender: bytes, received_ns: int) -> bool:
        known = self._senders.get((sender, topic)) or _Sender()
        before = known.sequence
        if sequence <= before:
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
            self.fault = f"{topic}: {age_ns / NS_PER_S:.2f} s old"
            if estimate or not known.ages.was_set(published_ns, received_wall_ns, sequence == before + 1):
                self.stale += 1
                return False
            self.fault = f"{topic}: the clock of its sender was set back by {age_ns / NS_PER_S:.2f} s"
        if not before:
            self._remember(sender, topic, known)
        return True

    def _remember(self, sender: bytes, topic: str, known: _Sender) -> None:
        """Only who has commanded is, and nobody who is obeyed is forgotten: old commands would be new again."""
        if len(self._senders) >= _MOST_SENDERS:
            obeyed = {self.master, *[stranger for stranger, _ in self._strangers.values()]}
            del self._senders[next(key for key in self._senders if key[0] not in obeyed)]
        self._senders[sender, topic] = known

    def _is_obeyed(self, topic: str, sender: bytes, now: int) -> bool:
        """Whether it is the master; or one of those without presence who are it together, each on its topics."""
        if not self._strangers or sender in self.ranks or self.master in self.ranks:
            return sender == self.master
        other, heard = self._strangers.get(topic, (sender, 0))
        return other == sender or self._is_silent(heard, now)

    def _is_silent(self, heard_ns: int, now: int) -> bool:
        """Whether who was heard last at `heard_ns` has been silent for long; in a crowd that is not known."""
        return now - max(heard_ns, self._crowded_ns) > self._hold_ns

    def _may_take_over(self, sender: bytes) -> bool:
        return not self.master or self.silent or self.ranks.get(sender, 0) > self.ranks.get(self.master, 0)

    def _obey(self, topic: str, sender: bytes, obeyed: bool, now: int) -> None:
        """Take note of who commands; `obeyed`: as before."""
        if not obeyed:
            self.master = sender
            self.news.set()
            self._strangers.clear()
            if self._orders:
                self._orders.forget()
        if sender not in self.ranks:
            self._strangers[topic] = sender, now
        self._obeyed_ns = now

    def _rest(self, now: int) -> None:
        """Let the reader sleep when more comes than may: the network's ring then drops all but the newest."""
        self._allowed_ns = max(self._allowed_ns + self._period_ns, now - _BURST_NS)
        if self._allowed_ns > now:
            self.flooded += 1
            time.sleep((self._allowed_ns - now) / NS_PER_S)

    def _pass_over(self, now: int) -> None:
        """Go on after what is not obeyed, as the master's next may be behind it; in a crowd let the loop breathe.

        The reader works for some messages at a stretch and never rests for so long that the network's ring overflows.
        """
        self._passed_ns = min(max(self._passed_ns + self._crowd_ns, now - _BURST_NS), now)
        if self._passed_ns == now:
            self._crowded_ns = now
            self.flooded += 1
            if self.flooded % _BREATHS == 0:
                time.sleep(_BREATH_S)


def read_velocity(payload: bytes) -> VelocityCommand | None:
    """What a message on cmd_vel asks for; None if that cannot be meant."""
    twist = ros.decode_twist(payload)
    if twist is None:
        return None
    (surge, sway, heave), (p, q, r) = twist
    if max(surge, sway, heave, p, q, r) > _MOST_SPEED or min(surge, sway, heave, p, q, r) < -_MOST_SPEED:
        return None
    return VelocityCommand(surge, sway, heave, r)
