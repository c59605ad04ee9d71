"""Monitor whether a vehicle is present, and measure the offset of its clock."""

import threading
from collections.abc import Callable

from hil.common.clock import NS_PER_S, from_wall_ns, now_ns, to_wall_ns
from hil.network.clock_offset import ClockOffset, Estimate
from hil.network.presence import declare_presence, watch_presence
from hil.network.session import Session
from hil.network.supervisor import Received
from hil.network.tokens import (
    PING,
    PONG,
    NodeRole,
    Presence,
    clock_keys,
    presence_keys,
    read_clock,
    read_presence,
)

PERIOD_S = 0.2  # of the clock exchange
GRACE_S = 0.1  # by which an answer may be later than the lease
STALL_S = 0.02  # time for the readers to catch up after this process was held up
FIRST_PERIOD_S = 0.02  # until there is an estimate
WAITING = 16  # answers that may wait for the reader
STORED_PINGS = 512  # pings whose answers are accepted as ours; at the first period this covers any answer time


class LivenessMonitor:
    """Announce this client to a node, track the node's presence, and compare clocks with it.

    A vehicle becomes present with its token or first answer. It is lost with its token, or when it has not answered for
    a little more than `lease` s. `present` says whether it is present, `losses` how often it was lost. When it appears,
    `arrived` is called in a separate thread, where it may block; `report` gets a line when it appears or is lost.

    `samples` counts messages other than answers; the receiving code increments it. `reconnections` counts how often the
    session's supervisor closed links or opened the session again (`hil.network.supervisor`).

    `same_clock` is set by the code that finds both processes on one machine: the offset is then exactly 0, unless
    exchanges contradict it because the wall clock was set between the two starts.
    """

    def __init__(
        self,
        session: Session,
        node: str,
        clock: ClockOffset,
        arrived: Callable[[], None],
        report: Callable[[str], None],
        lease: float,
    ) -> None:
        self._session, self._node, self._clock = session, node, clock
        self._arrived, self._report = arrived, report
        self._slaves: dict[str, str] = {}  # slaves of the node: ident -> machine and process
        self._doubled_ns = 0  # since when there is more than one; 0 if there is not
        self._lost_ns = 0
        self._received_ns = now_ns()  # until the first message, the silence counts from here
        self._patience_s = lease + GRACE_S
        self._lock = threading.Lock()  # guards `present`, which two threads change
        self._ping_times: tuple[int, ...] = ()  # wall times (ns) of our last pings
        self._send_as_master: Callable[[bytes], None] | None = None  # sends pings and the times of answers, if a master
        self._closing = threading.Event()
        self._withdraw: Callable[[], None] | None = None
        self._arrival: threading.Thread | None = None
        self._pinger = threading.Thread(target=self._ping, name="clock", daemon=True)
        self._replies = 0
        self.samples = self._counted = 0
        self.reconnections = 0
        self.known = threading.Event()  # set once the clocks have been compared
        self.same_clock = False
        self.present = False
        self.losses = 0
        self.reported: Estimate | None = None  # our clock minus the vehicle's, as the vehicle estimates it

    def begin(self, role: NodeRole, gid: bytes, rank: int) -> None:
        """Announce this process as `role`; `gid` is the id in its commands."""
        self._gid = gid
        ping, pong, masters_ping = clock_keys(self._node)
        self._send = self._session.sender(ping)
        if role == "master":
            self._send_as_master = self._session.sender(masters_ping)
        self._session.receive(pong, self._on_pong, WAITING)
        self._withdraw = declare_presence(self._session, self._node, role, gid.hex(), rank)
        watch_presence(self._session, self._node, self._on_presence)
        self._end_watch = self._session.supervisor.watch(
            self._node, self._arrivals, self._on_reconnection, self._may_be_running
        )
        self._pinger.start()

    def end(self) -> None:
        """Withdraw this process's presence. The session stays open."""
        self._closing.set()
        self._end_watch()
        self._pinger.join()
        with self._lock:
            arrival = self._arrival  # no new one is started once `_closing` is set
        if arrival:
            arrival.join()
        if self._withdraw:
            self._withdraw()

    def sent_ns(self, their_wall_ns: int, received_ns: int) -> int:
        """Convert a wall time of the vehicle to our monotonic clock (ns); `received_ns` if it is later or unknown."""
        received_wall_ns = to_wall_ns(received_ns)
        estimate = self._clock.at(received_wall_ns)
        if estimate is None:
            return received_ns
        is_same = self.same_clock and self._clock.may_be_zero(received_wall_ns)
        return min(from_wall_ns(their_wall_ns - (0 if is_same else estimate.offset_ns)), received_ns)

    def forget_clock(self) -> None:
        """Restart the comparison of clocks, because another process now publishes for the vehicle."""
        self._clock.forget()
        self.known.clear()

    @property
    def rivals(self) -> str:
        """Return the slaves that share the node's name, as text; "" for a single one.

        After a restart of a slave, the old one may remain for its lease, so two count only after a little more.
        """
        if not self._doubled_ns or now_ns() - self._doubled_ns < self._patience_s * NS_PER_S:
            return ""
        return " and ".join(sorted(self._slaves.values()))

    @property
    def silence_s(self) -> float:
        """Seconds since the last message of the vehicle, or since this monitor was made."""
        return (now_ns() - self._received_ns) / NS_PER_S

    @property
    def silence(self) -> str:
        """For how long the vehicle has not answered, in words."""
        return f"has not answered {'for' if self._replies else 'yet, within'} {self.silence_s:.1f} s"

    def _ping(self) -> None:
        while not self._wait_for_next():
            if self.present and self._is_timed_out() and not self._closing.wait(STALL_S) and self._is_timed_out():
                self._set_present(False)
            sent = to_wall_ns(now_ns())
            self._ping_times = (*self._ping_times[1 - STORED_PINGS :], sent)
            ping = PING.pack(self._gid, sent, 0, 0)
            if self._send_as_master:
                self._send_as_master(ping)
            if not self._send_as_master or not self.reported:  # the vehicle does not yet know us as a master
                self._send(ping)

    def _wait_for_next(self) -> bool:
        """Wait until the next ping is due; return True when closing.

        Time in which this process was held up does not count as silence of the vehicle: nothing was sent or read then.
        """
        began, pause_s = now_ns(), self._pause()
        is_closing = self._closing.wait(pause_s)
        held_up_ns = now_ns() - began - round(pause_s * NS_PER_S)
        if held_up_ns > STALL_S * NS_PER_S:
            self._received_ns = min(self._received_ns + held_up_ns, now_ns())
        return is_closing

    def _pause(self) -> float:
        """Return the time (s) until the next ping, at most until the vehicle times out."""
        if not self.known.is_set():
            return FIRST_PERIOD_S
        left = self._patience_s - (now_ns() - self._received_ns) / NS_PER_S
        return min(PERIOD_S, left) if self.present and left > 0.0 else PERIOD_S

    def _is_timed_out(self) -> bool:
        return now_ns() - self._received_ns >= self._patience_s * NS_PER_S

    def _on_reconnection(self, line: str) -> None:
        self.reconnections += 1
        self._report(line)

    def _arrivals(self) -> Received:
        """Return what has arrived; nothing is answered if the vehicle is not present although each peer has a link."""
        may_answer = not self.present and (self.losses or self._session.has_pairs)
        is_unanswered = bool(may_answer) and self._session.supervisor.is_linked()
        if not is_unanswered:  # else a sample is no proof: some of the session's declarations may be lost
            self._counted = self.samples
        return Received(self._replies, self._counted, is_unanswered)

    def _may_be_running(self) -> bool:
        """Return whether the vehicle may still run. If it has ended, the session is not at fault.

        A direct link leads to the vehicle itself. A router keeps its link without the vehicle, but knows the present
        ones. If the router knows none, it may have lost their declarations, or we may have lost its answer.
        """
        if self._session.has_pairs or self.present:
            return True
        tokens = self._session.tokens(presence_keys("*", "slave"))
        known = {presence.node for presence in map(read_presence, tokens) if presence}
        return not known or self._node in known

    def _on_pong(self, payload: bytes) -> None:
        received_ns = to_wall_ns(now_ns())
        pong = read_clock(PONG, payload)
        if pong is None or pong[0] != self._gid or pong[1] not in self._ping_times:  # answers another client's ping
            return
        _, sent, arrived, answered, *reported = pong
        if self._send_as_master:
            self._send_as_master(PING.pack(self._gid, to_wall_ns(now_ns()), answered, received_ns))
        self._received_ns = now_ns()
        self._replies += 1
        self.reported = Estimate(*reported) if reported[1] >= 0 else None
        self._clock.add(sent, arrived, answered, received_ns)
        self.known.set()
        self._set_present(True)

    def _on_presence(self, presence: Presence, alive: bool) -> None:
        if presence.role != "slave":
            return
        if alive:
            self._slaves[presence.ident] = presence.process
            self._received_ns = now_ns()  # its first answer needs some time
        else:
            self._slaves.pop(presence.ident, None)
        self._doubled_ns = (self._doubled_ns or now_ns()) if len(self._slaves) > 1 else 0
        self._set_present(bool(self._slaves))

    def _set_present(self, present: bool) -> None:
        with self._lock:
            if present == self.present or self._closing.is_set():
                return
            self.present = present
            if present:
                self._arrival = threading.Thread(target=self._arrived, name="arrival", daemon=True)
                self._arrival.start()
        if not present:
            self.reported = None  # our rights may be different when it is back
            self.losses += 1
            self._lost_ns = now_ns()
            self._report(f"{self._node} at {self._session.name} is lost; trying to connect again")
            return
        if self._lost_ns:
            self._report(f"{self._node} is back after {(now_ns() - self._lost_ns) / NS_PER_S:.1f} s")
