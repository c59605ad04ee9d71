"""Who is there on the network: masters that come and go, their clocks and ranks, and the last state for late joiners.

Loaded when the vehicle is ready; until then commands are taken as from strangers.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from hil.clock import NS_PER_MS, now_ns, to_wall_ns
from hil.slave.inbox import Inbox
from hil.slave.outbox import Outbox
from hil.transport.clock_offset import ClockOffset
from hil.transport.presence import declare_presence, serve_last, watch_presence
from hil.transport.session import Session
from hil.transport.tokens import PING, PONG, Part, Presence, clock_keys, read_clock

if TYPE_CHECKING:
    from hil.transport.security import Security

WAITING = 16  # pings that may wait for the reader; half of that for all but masters
MOST_THERE = 32  # that are told apart, of each part
PINGS_A_S = 200  # that are answered of all but masters: so many observers, and some to spare


class Contacts:
    """Keeps an inbox informed about its senders, and those about the vehicle."""

    def __init__(
        self,
        session: Session,
        node: str,
        inbox: Inbox,
        outbox: Outbox,
        report: Callable[[str], None],
        security: "Security | None",
    ) -> None:
        self._inbox = inbox
        self._rights = security.rights() if security else {}
        self._report = report
        self._there: dict[Part, dict[str, Presence]] = {"master": {}, "observer": {}}
        self.lost = 0
        ping, pong, masters_ping = clock_keys(node)
        self._answer = session.sender(pong)
        self._pings = (
            session.receive(ping, self._take_ping, WAITING // 2, PINGS_A_S),
            session.receive(masters_ping, self._take_masters_ping, WAITING),
        )
        session.free_links()
        serve_last(session, node, outbox.catch_up)
        watch_presence(session, node, self._meet)
        declare_presence(session, node, "slave")

    def figures(self) -> dict[str, str]:
        """For the diagnostics: who is there, who is obeyed, and how that one's clock runs against ours."""
        inbox = self._inbox
        masters = list(self._there["master"].values())
        figures = self._rights | {
            "commanded_by": "" if inbox.silent else inbox.master.hex(),
            "commander": " ".join([master.who for master in masters if master.ident == inbox.master.hex()]),
            "masters": " ".join([master.who for master in masters]),
            "observers": str(len(self._there["observer"])),
            "masters_lost": str(self.lost),
            "pings_dropped": str(sum([pings.lost for pings in self._pings])),
        }
        clock = inbox.clocks.get(inbox.master)
        estimate = clock.at(to_wall_ns(now_ns())) if clock else None
        if clock and estimate:
            figures |= {
                "clock_offset_ms": f"{estimate.offset_ns / NS_PER_MS:.4f}",
                "clock_uncertainty_ms": f"{estimate.uncertainty_ns / NS_PER_MS:.4f}",
                "clock_drift_ppm": f"{estimate.drift * 1e6:.2f}",
                "clock_steps": str(clock.steps),
            }
        return figures

    def _meet(self, presence: Presence, alive: bool) -> None:
        if presence.part == "slave":
            return
        there = self._there[presence.part]
        if alive and len(there) < MOST_THERE:
            there[presence.ident] = presence
        elif not alive:
            there.pop(presence.ident, None)
        if presence.part == "master":
            self._meet_master(presence, alive)

    def _meet_master(self, presence: Presence, alive: bool) -> None:
        sender = bytes.fromhex(presence.ident)
        if alive:
            self._inbox.ranks[sender] = presence.rank
            rank = f" with rank {presence.rank}" if presence.rank else ""
            self._report(f"master {presence.who} is there{rank}")
        else:
            obeyed = sender == self._inbox.master
            self._inbox.forget(sender)
            self.lost += 1
            self._report(f"master {presence.who} is gone" + (", which commanded" if obeyed else ""))

    def _take_ping(self, payload: bytes) -> None:
        """Answer at once, whoever asks."""
        came = to_wall_ns(now_ns())
        ping = self._read(payload)
        if ping:
            self._tell_time(ping[0], ping[1], came)

    def _take_masters_ping(self, payload: bytes) -> None:
        """It asks too, or ends the exchange that our answer began."""
        came = to_wall_ns(now_ns())
        ping = self._read(payload)
        if ping:
            sender, sent, answered, answer_came = ping
            if answered:
                self._clock_of(sender).add(answered, answer_came, sent, came)
            else:
                self._tell_time(sender, sent, came)

    def _tell_time(self, sender: bytes, sent: int, came: int) -> None:
        clock = self._inbox.clocks.get(sender)
        estimate = clock.at(came) if clock else None
        told = estimate if estimate else (0, -1, 0.0)
        self._answer(PONG.pack(sender, sent, came, to_wall_ns(now_ns()), *told))

    def _read(self, payload: bytes) -> tuple[Any, ...] | None:
        ping = read_clock(PING, payload)
        self._inbox.malformed += ping is None
        return ping

    def _clock_of(self, sender: bytes) -> ClockOffset:
        clocks = self._inbox.clocks
        if sender not in clocks:
            while len(clocks) >= MOST_THERE:  # many strangers do not make the one that is obeyed forgotten
                del clocks[next(other for other in clocks if other != self._inbox.master)]
            clocks[sender] = ClockOffset()
        return clocks[sender]
