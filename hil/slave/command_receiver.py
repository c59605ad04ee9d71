"""Receive commands: decode them in the reader's thread, check age and sender, and hand them to the loop.

A vehicle has one active master at a time: the first one whose command arrives, until it leaves or sends nothing for
the deadman's time. Commands of others are refused meanwhile, except from a master with a higher rank, which takes over.
ROS 2 nodes, which do not identify themselves, count together as one master while each uses topics of its own. Refused
commands are not decoded, so that a flood of them costs little, does not hide the active master's commands, and is not
taken for its timeout.
"""

import os
import threading
import time
from collections import deque
from typing import TYPE_CHECKING, Any

from hil.autonomy.control.controller import VelocityCommand
from hil.common.clock import NS_PER_MS, NS_PER_S, now_ns, to_wall_ns
from hil.ros import encoders as ros
from hil.ros.topics import COMMANDS

if TYPE_CHECKING:
    from hil.common.vectors import Vector3
    from hil.network.clock_offset import ClockOffset
    from hil.slave.command_mux import CommandMux
    from hil.slave.setpoints import Setpoint

_DRIFT_PER_S = 50_000  # ns: how fast two clocks may run apart (50 ppm)
_STEADY_NS = 20 * NS_PER_MS  # ages that differ by less are the same,
_AGREE_NS = NS_PER_S  # if there is one of them that often,
_STEADY_FOR_NS = 5 * NS_PER_S  # and for so long; no replay and no queue that grows or drains keeps an age like that
_MOST_SENDERS = 64  # whose sequence numbers are remembered, topic by topic
_MOST_SPEED = 100.0  # m/s and rad/s: what asks for more is not meant
_BURST_NS = 100 * NS_PER_MS  # how long commands may come faster than their limit
_OVERLOAD = 1000.0  # per second: with more refused commands, accepted ones may be lost among them
_YIELD_EVERY = 4  # refused commands between two pauses: fewer than the network's ring stores
_YIELD_S = 0.0001


class Received:
    """A command with its times: `published_ns` by the master's wall clock, `received_ns` by our monotonic clock."""

    __slots__ = ("command", "published_ns", "received_ns", "sequence")

    def __init__(self, command: "Setpoint", sequence: int, published_ns: int, received_ns: int) -> None:
        self.command = command
        self.sequence = sequence
        self.published_ns = published_ns
        self.received_ns = received_ns


class AgeFilter:
    """Estimate the age of messages beyond that of the fastest one, without synchronised clocks.

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
        """Return the age of a message (ns) beyond that of the fastest one so far."""
        difference = received_wall_ns - sent_wall_ns
        if self._least is None:
            self._least = difference
        else:
            grown = (received_wall_ns - self._last) * _DRIFT_PER_S // NS_PER_S
            self._least = min(self._least + grown, difference)
        self._last = received_wall_ns
        return difference - self._least

    def was_set(self, sent_wall_ns: int, received_wall_ns: int, follows: bool) -> bool:
        """Return whether the sender's clock makes a message look old, and not its way; if so, ages begin again with it.

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
    """State of one sender on one topic."""

    __slots__ = ("ages", "sequence")

    def __init__(self) -> None:
        self.sequence = 0
        self.ages = AgeFilter()


class CommandReceiver:
    """Store the newest command; `fileno` becomes readable when there is one.

    `clocks` and `ranks`, by sender, are filled in by `hil.slave.contacts`; a sender without them (a ROS 2 node) is
    judged by its fastest message and has rank 0. `master` is who is obeyed, b"" at first; `wakeup` is set when that
    changes. `thrusters` is how many the vehicle has. `fault` is what was wrong with the last command that could be read
    and yet not be obeyed; "" if there was none.

    Counts what it drops: `malformed`, `stale` (older than the limit), `disordered` (overtaken by a newer one of the
    same sender), `refused` (another master is obeyed), `flooded` (times the rate was above its limit, when the
    reader rests and the network keeps but the newest; or of all together) and `superseded` (replaced before the
    loop took it).
    """

    def __init__(
        self,
        age_limit_ns: int,
        hold_ns: int = NS_PER_S // 2,
        rate: float = 200.0,
        thrusters: int = 0,
        wakeup: threading.Event | None = None,
    ) -> None:
        self._age_limit_ns = age_limit_ns
        self._hold_ns = hold_ns
        self._period_ns = round(NS_PER_S / rate)
        self._event = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._newest: deque[Received] = deque(maxlen=1)  # its append and popleft are atomic
        self._senders: dict[tuple[bytes, str], _Sender] = {}
        self._anonymous: dict[str, tuple[bytes, int]] = {}  # sender and last reception by topic
        self.thrusters = thrusters
        self._mux: CommandMux | None = None
        self._accepted_ns = 0
        self._allowed_ns = 0  # by when as many commands as have come may have come
        self._overload_period_ns = round(NS_PER_S / max(rate, _OVERLOAD))
        self._refused_until_ns = 0  # by when the refused commands so far are within the limit
        self._overloaded_ns = 0  # when they last exceeded it
        self.clocks: dict[bytes, ClockOffset] = {}
        self.ranks: dict[bytes, int] = {}
        self.master = b""
        self.fault = ""
        self.wakeup = wakeup or threading.Event()
        self.received = 0
        self.malformed = 0
        self.stale = 0
        self.disordered = 0
        self.refused = 0
        self.flooded = 0
        self.superseded = 0

    def fileno(self) -> int:
        """Return the descriptor that becomes readable when a command is waiting."""
        return self._event

    def on_message(self, topic: str, payload: bytes, attachment: bytes) -> None:
        """Check one message and store its command; called in the reader's thread."""
        received_ns = now_ns()
        self.received += 1
        stamp = ros.unpack_attachment(attachment)
        is_active = stamp is not None and self._is_active_master(topic, stamp.gid, received_ns)
        if stamp is None:
            self.malformed += 1
        elif not is_active and not self._may_take_over(stamp.gid):
            self.refused += 1
        else:
            value = decode_velocity(payload) if topic == "cmd_vel" else self._decode(topic, payload)
            if value is None:
                self.malformed += 1
            elif self._is_new(topic, *stamp, received_ns):
                self._accept(topic, stamp.gid, is_active, received_ns)
                command = self._mux.combine(topic, value, received_ns) if self._mux else value
                self.superseded += len(self._newest)
                self._newest.append(Received(command, stamp.sequence, stamp.time_ns, received_ns))
                os.eventfd_write(self._event, 1)
                self._limit_rate(received_ns)
                return
        self._limit_refused(received_ns)

    def take_latest(self) -> Received | None:
        """Return the newest command not yet taken; None if there is none, or it has become old while nobody took it."""
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
    def is_master_timed_out(self) -> bool:
        """True if the active master has sent nothing for so long that any other may command."""
        return self._is_timed_out(self._accepted_ns, now_ns())

    def remove_sender(self, sender: bytes) -> None:
        """Remove a master that has left; another may command at once."""
        self.ranks.pop(sender, None)
        self.clocks.pop(sender, None)
        if sender == self.master:
            self.master = b""
            self._anonymous.clear()  # of which it was one, if it commanded before it was known
            self.wakeup.set()

    def close(self) -> None:
        """Give the descriptor back. The reader must have ended."""
        os.close(self._event)

    def _decode(self, topic: str, payload: bytes) -> Any:
        """Return a decoded message of another topic than cmd_vel; None if it cannot be obeyed."""
        if topic not in COMMANDS:
            return None
        if self._mux is None:
            from hil.slave.command_mux import CommandMux  # most runs do without

            self._mux = CommandMux(self.thrusters, self._hold_ns)
        self._mux.fault = ""
        value = self._mux.read(topic, payload)
        self.fault = self._mux.fault or self.fault
        return velocity_of(value) if topic == "cmd_vel_stamped" else value

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
            self._add_sender(sender, topic, known)
        return True

    def _add_sender(self, sender: bytes, topic: str, known: _Sender) -> None:
        """Store a sender. An active one is never removed: its old commands would pass as new."""
        if len(self._senders) >= _MOST_SENDERS:
            active = {self.master, *[anonymous for anonymous, _ in self._anonymous.values()]}
            del self._senders[next(key for key in self._senders if key[0] not in active)]
        self._senders[sender, topic] = known

    def _is_active_master(self, topic: str, sender: bytes, now: int) -> bool:
        """Return whether the sender is the active master, or one of its anonymous nodes on a topic of its own."""
        if not self._anonymous or sender in self.ranks or self.master in self.ranks:
            return sender == self.master
        other, received_ns = self._anonymous.get(topic, (sender, 0))
        return other == sender or self._is_timed_out(received_ns, now)

    def _is_timed_out(self, received_ns: int, now: int) -> bool:
        """Return whether a sender has timed out; never during overload, which hides commands."""
        return now - max(received_ns, self._overloaded_ns) > self._hold_ns

    def _may_take_over(self, sender: bytes) -> bool:
        return not self.master or self.is_master_timed_out or self.ranks.get(sender, 0) > self.ranks.get(self.master, 0)

    def _accept(self, topic: str, sender: bytes, is_active: bool, now: int) -> None:
        """Make the sender the active master, unless it is already (`is_active`)."""
        if not is_active:
            self.master = sender
            self.wakeup.set()
            self._anonymous.clear()
            if self._mux:
                self._mux.clear()
        if sender not in self.ranks:
            self._anonymous[topic] = sender, now
        self._accepted_ns = now

    def _limit_rate(self, now: int) -> None:
        """Sleep while commands exceed their rate limit; the network's ring then stores only the newest."""
        self._allowed_ns = max(self._allowed_ns + self._period_ns, now - _BURST_NS)
        if self._allowed_ns > now:
            self.flooded += 1
            time.sleep((self._allowed_ns - now) / NS_PER_S)

    def _limit_refused(self, now: int) -> None:
        """Continue after a refused command; during overload, pause so that the loop gets the processor.

        The reader handles some messages between pauses and never sleeps so long that the network's ring overflows.
        """
        self._refused_until_ns = min(max(self._refused_until_ns + self._overload_period_ns, now - _BURST_NS), now)
        if self._refused_until_ns == now:
            self._overloaded_ns = now
            self.flooded += 1
            if self.flooded % _YIELD_EVERY == 0:
                time.sleep(_YIELD_S)


def decode_velocity(payload: bytes) -> VelocityCommand | None:
    """Return what a message on cmd_vel asks for; None if that cannot be meant."""
    return velocity_of(ros.decode_twist(payload))


def velocity_of(twist: "tuple[Vector3, Vector3] | None") -> VelocityCommand | None:
    """Return the command of linear (m/s) and angular (rad/s) velocity along FRD; None if that cannot be meant."""
    if twist is None:
        return None
    (surge, sway, heave), (p, q, r) = twist
    if max(surge, sway, heave, p, q, r) > _MOST_SPEED or min(surge, sway, heave, p, q, r) < -_MOST_SPEED:
        return None
    return VelocityCommand(surge, sway, heave, r)
