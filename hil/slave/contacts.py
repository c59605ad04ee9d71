"""Who is there on the network: masters that come and go, their clocks and ranks, and the last state for late joiners.

Loaded when the vehicle is ready; until then commands are taken as from strangers.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING

from hil.clock import NS_PER_MS, now_ns, to_wall_ns
from hil.slave.inbox import Inbox
from hil.slave.outbox import Outbox
from hil.transport.clock_offset import ClockOffset
from hil.transport.presence import declare_presence, serve_last, watch_presence
from hil.transport.session import Session
from hil.transport.tokens import PING, PONG, Presence, clock_keys

if TYPE_CHECKING:
    from hil.transport.security import Security

WAITING = 16  # pings that may wait for the reader
MOST_THERE = 32  # that are told apart


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
        self._there: dict[str, Presence] = {}
        self.lost = 0
        ping, pong = clock_keys(node)
        self._answer = session.sender(pong)
        session.receive(ping, self._take_ping, WAITING)
        session.free_links()
        serve_last(session, node, outbox.catch_up)
        watch_presence(session, node, self._meet)
        declare_presence(session, node, "slave")

    def figures(self) -> dict[str, str]:
        """For the diagnostics: who is there, who is obeyed, and how that one's clock runs against ours."""
        inbox = self._inbox
        there = list(self._there.values())
        figures = self._rights | {
            "commanded_by": "" if inbox.silent else inbox.master.hex(),
            "commander": " ".join([presence.who for presence in there if presence.ident == inbox.master.hex()]),
            "masters": " ".join([presence.who for presence in there if presence.part == "master"]),
            "observers": str(sum(presence.part == "observer" for presence in there)),
            "masters_lost": str(self.lost),
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
        if alive and len(self._there) < MOST_THERE:
            self._there[presence.ident] = presence
        elif not alive:
            self._there.pop(presence.ident, None)
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
        """Answer at once; a ping also ends the exchange that our answer before it began."""
        came = to_wall_ns(now_ns())
        if len(payload) != PING.size:
            self._inbox.malformed += 1
            return
        sender, sent, answered_before, answer_came = PING.unpack(payload)
        clock = self._clock_of(sender)
        if answered_before:
            clock.add(answered_before, answer_came, sent, came)
        estimate = clock.at(came)
        told = estimate if estimate else (0, -1, 0.0)
        self._answer(PONG.pack(sender, sent, came, to_wall_ns(now_ns()), *told))

    def _clock_of(self, sender: bytes) -> ClockOffset:
        clocks = self._inbox.clocks
        if sender not in clocks:
            while len(clocks) >= MOST_THERE:
                del clocks[next(iter(clocks))]
            clocks[sender] = ClockOffset()
        return clocks[sender]
