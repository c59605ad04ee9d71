"""Whether a vehicle is there, and how its clock runs against ours."""

import threading
from collections.abc import Callable

from hil.clock import NS_PER_S, from_wall_ns, now_ns, to_wall_ns
from hil.transport.clock_offset import ClockOffset, Estimate
from hil.transport.presence import declare_presence, watch_presence
from hil.transport.session import Session
from hil.transport.tokens import PING, PONG, Part, Presence, clock_keys, read_clock

PERIOD_S = 0.2  # of the exchange of clocks
GRACE_S = 0.1  # that an answer may be later than the lease
STALL_S = 0.02  # in which readers catch up when this process itself was held up
FIRST_PERIOD_S = 0.02  # until there is an estimate
WAITING = 16  # answers that may wait for the reader
ASKED = 512  # pings whose answers are known as ours: as long back as an answer may take, at the first period


class Contact:
    """Announces us to a node, sees it come and go, and keeps comparing clocks with it.

    It comes with its token or its first answer, and goes with its token or when it has not answered for a little
    more than `lease` s. `present` says whether it is there, `losses` how often it went. `arrived` is called in a
    thread of its own, which may wait a while, when the vehicle comes; `report` gets a line when it comes and goes.
    `same_clock` is set by whoever finds that both are on one machine: then the offset is exactly 0.
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
        self._there: set[str] = set()
        self._lost_ns = 0
        self._heard_ns = 0
        self._patience_s = lease + GRACE_S
        self._turn = threading.Lock()  # of coming and going, which two threads see
        self._asked: tuple[int, ...] = ()  # when our last pings were sent
        self._tell: Callable[[bytes], None] | None = None  # as a master: how an answer came
        self._closing = threading.Event()
        self._withdraw: Callable[[], None] | None = None
        self._arrival: threading.Thread | None = None
        self._pinger = threading.Thread(target=self._ping, name="clock", daemon=True)
        self.known = threading.Event()  # the clocks have been compared
        self.same_clock = False
        self.present = False
        self.losses = 0
        self.told: Estimate | None = None  # our clock minus the vehicle's, as the vehicle reckons

    def begin(self, part: Part, gid: bytes, rank: int) -> None:
        """Announce us as `part`; commands carry `gid`."""
        self._gid = gid
        ping, pong, masters_ping = clock_keys(self._node)
        self._send = self._session.sender(ping)
        if part == "master":
            self._tell = self._session.sender(masters_ping)
        self._session.receive(pong, self._take_pong, WAITING)
        self._withdraw = declare_presence(self._session, self._node, part, gid.hex(), rank)
        watch_presence(self._session, self._node, self._meet)
        self._pinger.start()

    def end(self) -> None:
        """Leave. The session stays open."""
        self._closing.set()
        self._pinger.join()
        with self._turn:
            arrival = self._arrival  # no other comes any more
        if arrival:
            arrival.join()
        if self._withdraw:
            self._withdraw()

    def sent_ns(self, their_wall_ns: int, received_ns: int) -> int:
        """A wall instant of the vehicle by our monotonic clock, no later than `received_ns`, which it is if unknown."""
        if self.same_clock:
            return min(from_wall_ns(their_wall_ns), received_ns)
        estimate = self._clock.at(to_wall_ns(received_ns))
        return min(from_wall_ns(their_wall_ns - estimate.offset_ns), received_ns) if estimate else received_ns

    @property
    def silence_s(self) -> float:
        """Seconds since the vehicle was last heard of."""
        return (now_ns() - self._heard_ns) / NS_PER_S

    def _ping(self) -> None:
        while not self._closing.wait(self._pause()):
            if self.present and self._silent() and not self._closing.wait(STALL_S) and self._silent():
                self._is_there(False)
            sent = to_wall_ns(now_ns())
            self._asked = (*self._asked[1 - ASKED :], sent)
            ping = PING.pack(self._gid, sent, 0, 0)
            if self._tell:
                self._tell(ping)
            if not self._tell or not self.told:  # not a master, or nothing says yet that it is heard as one
                self._send(ping)

    def _pause(self) -> float:
        """Until the next ping; no longer than patience lasts."""
        if not self.known.is_set():
            return FIRST_PERIOD_S
        left = self._patience_s - (now_ns() - self._heard_ns) / NS_PER_S
        return min(PERIOD_S, left) if self.present and left > 0.0 else PERIOD_S

    def _silent(self) -> bool:
        return now_ns() - self._heard_ns >= self._patience_s * NS_PER_S

    def _take_pong(self, payload: bytes) -> None:
        came = to_wall_ns(now_ns())
        pong = read_clock(PONG, payload)
        if pong is None or pong[0] != self._gid or pong[1] not in self._asked:  # the answer to another's ping
            return
        _, sent, there, answered, *told = pong
        if self._tell:
            self._tell(PING.pack(self._gid, to_wall_ns(now_ns()), answered, came))
        self._heard_ns = now_ns()
        self.told = Estimate(*told) if told[1] >= 0 else None
        self._clock.add(sent, there, answered, came)
        self.known.set()
        self._is_there(True)

    def _meet(self, presence: Presence, alive: bool) -> None:
        if presence.part != "slave":
            return
        (self._there.add if alive else self._there.discard)(presence.ident)
        if alive:
            self._heard_ns = now_ns()  # give it time for its first answer
        self._is_there(bool(self._there))

    def _is_there(self, present: bool) -> None:
        with self._turn:
            if present == self.present or self._closing.is_set():
                return
            self.present = present
            if present:
                self._arrival = threading.Thread(target=self._arrived, name="arrival", daemon=True)
                self._arrival.start()
        if not present:
            self.told = None  # it may come back with other rights for us
            self.losses += 1
            self._lost_ns = now_ns()
            self._report(f"{self._node} at {self._session.name} is gone; trying to reach it again")
            return
        if self._lost_ns:
            self._report(f"{self._node} is back after {(now_ns() - self._lost_ns) / NS_PER_S:.1f} s")
