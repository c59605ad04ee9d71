"""Receive commands: decode them in the reader's thread, check age and sender, and pass them to the loop.

A vehicle has one active master at a time: the first one whose command arrives. It stays active until it leaves or its
commands stop for the deadman timeout. Meanwhile the commands of other masters are refused, unless a master has a higher
rank: then it takes over. Nodes of ROS 2, which do not identify themselves, together count as one master if each
uses a topic of its own. Refused commands are not decoded, so a flood of them costs little CPU. A flood neither hides
the active master's commands nor makes that master time out.
"""

import os
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from hil.autonomy.control.controller import VelocityCommand
from hil.common.clock import NS_PER_MS, NS_PER_S, now_ns, to_wall_ns
from hil.ros import encoders as ros
from hil.ros.topics import COMMANDS

if TYPE_CHECKING:
    from hil.common.vectors import Vector3
    from hil.network.clock_offset import ClockOffset
    from hil.ros.diagnostics import Diagnostics
    from hil.slave.command_mux import CommandMux
    from hil.slave.setpoints import Setpoint

ACCESSORIES = "cmd_accessories"
_DRIFT_PER_S = 50_000  # ns a second: assumed limit of the drift between two clocks (50 ppm)
_SET_NS = 20 * NS_PER_MS  # by which a message must look too old before a clock counts as set
_MAX_SENDERS = 64  # pairs of sender and topic whose last sequence number is stored
_MAX_SPEED = 100.0  # m/s and rad/s; a faster command is taken for an error of its sender
_BURST_NS = 100 * NS_PER_MS  # how long commands may exceed their rate limit
_OVERLOAD = 1000.0  # refused commands a second; above this rate, commands of the active master may be lost
_YIELD_EVERY = 4  # refused commands between two pauses; fewer than the network's ring buffer holds
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
    """Estimate how much older messages are than the fastest one, without synchronised clocks.

    The smallest difference between receive time and send time counts as age zero. It grows slowly, to follow the drift
    between the two clocks. The difference cannot grow by more than the time since the message before, however long a
    queue was. If it does, one of the clocks was set, `was_set`, and the message counts as old as the one before.
    """

    def __init__(self) -> None:
        self._least = self._difference = 0
        self._received_ns: int | None = None
        self.was_set = False

    def age_ns(self, sent_wall_ns: int, received_wall_ns: int, received_ns: int) -> int:
        """Return how much older (ns) this message is than the fastest one so far.

        It was sent at `sent_wall_ns` by the sender's clock; `received_ns` is monotonic, `received_wall_ns` the same by
        our wall clock.
        """
        before, self._difference = self._difference, received_wall_ns - sent_wall_ns
        if self._received_ns is None:
            self._least = self._difference
        else:
            passed = received_ns - self._received_ns
            self.was_set = self._difference - before > passed + _SET_NS
            if self.was_set:
                self._least += self._difference - before
            self._least = min(self._least + passed * _DRIFT_PER_S // NS_PER_S, self._difference)
        self._received_ns = received_ns
        return self._difference - self._least


class _Sender:
    """Last sequence number and ages of one sender on one topic."""

    __slots__ = ("ages", "sequence")

    def __init__(self) -> None:
        self.sequence = 0
        self.ages = AgeFilter()


class CommandReceiver:
    """Store the newest command; the descriptor `fileno()` becomes readable when there is one.

    `hil.slave.contacts` fills in `clocks` and `ranks`, both by sender id. A sender without them (a ROS 2 node) has rank
    0, and the age of its messages is measured against its fastest one. `master` is the id of the active master, b"" at
    first; `wakeup` is set when it changes. `move` gets the shares of accessories at once; None if the vehicle has none.
    Their commands need the same permission as others, but make nobody the active master. `thrusters` is the number of
    the vehicle's thrusters. `fault` describes the last command that was decoded but rejected; "" if there was none.

    Counters of dropped commands: `malformed`; `stale` (older than the age limit); `disordered` (arrived after a newer
    one of the same sender); `refused` (another master is active); `superseded` (replaced before the loop read it).
    `flooded` counts how often accepted or refused commands exceeded their rate limit; the reader then sleeps, and the
    network stores only the newest command.
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
        self.move: Callable[[Mapping[str, float]], None] | None = None
        self._event = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._newest: deque[Received] = deque(maxlen=1)  # its append and popleft are atomic
        self._senders: dict[tuple[bytes, str], _Sender] = {}
        self._anonymous: dict[str, tuple[bytes, int]] = {}  # topic -> sender and time (ns) of its last command
        self.thrusters = thrusters
        self._mux: CommandMux | None = None
        self._accepted_ns = 0
        self._allowed_ns = 0  # monotonic time at which the commands so far are within the rate limit
        self._overload_period_ns = round(NS_PER_S / max(rate, _OVERLOAD))
        self._refused_until_ns = 0  # monotonic time at which the refused commands so far are within their limit
        self._overloaded_ns = 0  # when they last exceeded that limit
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
        is_active = stamp is not None and self._is_active_master(topic, stamp.master, received_ns)
        if stamp is None:
            self.malformed += 1
        elif not is_active and not self._may_take_over(stamp.master):
            self.refused += 1
        else:
            value: Any = decode_velocity(payload) if topic == "cmd_vel" else self._decode(topic, payload)
            if value is None:
                self.malformed += 1
            elif self._is_new(topic, stamp.sequence, stamp.time_ns, stamp.master, received_ns):
                if topic == ACCESSORIES and self.move:
                    self.move(value)
                    self._limit_rate(received_ns)
                    return
                self._accept(topic, stamp.master, is_active, received_ns)
                command = self._mux.combine(topic, value, received_ns) if self._mux else value
                self.superseded += len(self._newest)
                self._newest.append(Received(command, stamp.sequence, stamp.time_ns, received_ns))
                os.eventfd_write(self._event, 1)
                self._limit_rate(received_ns)
                return
        self._limit_refused(received_ns)

    def take_latest(self) -> Received | None:
        """Return the newest command, once; None if there is none or it has become too old before this call."""
        try:
            os.eventfd_read(self._event)
            newest = self._newest.popleft()
        except (BlockingIOError, IndexError):  # no new command, or it was read by the call before
            return None
        if now_ns() - newest.received_ns > self._age_limit_ns:  # this process was stopped for a while
            self.stale += 1
            return None
        return newest

    @property
    def is_master_timed_out(self) -> bool:
        """True if the active master has sent no command for the deadman timeout, so that any other may command."""
        return self._is_timed_out(self._accepted_ns, now_ns())

    def remove_sender(self, sender: bytes) -> None:
        """Remove a master that has left; another may become active at once."""
        self.ranks.pop(sender, None)
        self.clocks.pop(sender, None)
        if sender == self.master:
            self.master = b""
            self._anonymous.clear()  # it may contain this master, if it commanded before its presence was known
            self.wakeup.set()

    def add_figures(self, figures: "Diagnostics") -> None:
        """Add the counters of commands."""
        figures.thrusters = self.thrusters
        figures.commands_fault = self.fault
        for name in ("received", "malformed", "stale", "disordered", "superseded", "refused", "flooded"):
            figures[f"commands_{name}"] = getattr(self, name)

    def close(self) -> None:
        """Close the descriptor. The reader's thread must have ended."""
        os.close(self._event)

    def _decode(self, topic: str, payload: bytes) -> Any:
        """Return the decoded message of a topic other than cmd_vel; None if it is malformed or does not fit."""
        if topic not in COMMANDS:
            return None
        if topic == ACCESSORIES and self.move is None:
            self.fault = f"{topic}: the vehicle has no [accessories]"
            return None
        if self._mux is None:
            from hil.slave.command_mux import CommandMux  # not needed by most runs

            self._mux = CommandMux(self.thrusters, self._hold_ns)
        value = self._mux.decode(topic, payload)
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
        age_ns = known.ages.age_ns(published_ns, received_wall_ns, received_ns)
        clock = self.clocks.get(sender)
        if known.ages.was_set:
            self.fault = f"{topic}: the clock of its sender was set back, or ours was set forward"
            if clock:
                clock.forget()
        estimate = clock.at(received_wall_ns) if clock else None
        if estimate:
            age_ns = received_wall_ns + estimate.offset_ns - published_ns
        if age_ns > self._age_limit_ns:
            self.fault = f"{topic}: {age_ns / NS_PER_S:.2f} s old"
            self.stale += 1
            return False
        if not before:
            self._add_sender(sender, topic, known)
        return True

    def _add_sender(self, sender: bytes, topic: str, known: _Sender) -> None:
        """Store a sender. Active senders are never removed: otherwise their old commands would count as new."""
        if len(self._senders) >= _MAX_SENDERS:
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
        """Return whether a sender has timed out; never during overload, when its commands may have been lost."""
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
        """Sleep while commands exceed their rate limit; the network's ring buffer then stores only the newest one."""
        self._allowed_ns = max(self._allowed_ns + self._period_ns, now - _BURST_NS)
        if self._allowed_ns > now:
            self.flooded += 1
            time.sleep((self._allowed_ns - now) / NS_PER_S)

    def _limit_refused(self, now: int) -> None:
        """Limit the rate of refused commands: pause during overload, so that the loop gets the processor.

        The pauses are so short, and so many messages are handled between them, that the network's ring buffer does not
        overflow.
        """
        self._refused_until_ns = min(max(self._refused_until_ns + self._overload_period_ns, now - _BURST_NS), now)
        if self._refused_until_ns == now:
            self._overloaded_ns = now
            self.flooded += 1
            if self.flooded % _YIELD_EVERY == 0:
                time.sleep(_YIELD_S)


def decode_velocity(payload: bytes) -> VelocityCommand | None:
    """Return the velocity command in a cmd_vel message; None if it is malformed or too fast to be meant."""
    return velocity_of(ros.decode_twist(payload))


def velocity_of(twist: "tuple[Vector3, Vector3] | None") -> VelocityCommand | None:
    """Return the command for linear (m/s) and angular (rad/s) velocity, FRD; None if it is too fast to be meant."""
    if twist is None:
        return None
    (surge, sway, heave), (p, q, r) = twist
    if max(surge, sway, heave, p, q, r) > _MAX_SPEED or min(surge, sway, heave, p, q, r) < -_MAX_SPEED:
        return None
    return VelocityCommand(surge, sway, heave, r)
