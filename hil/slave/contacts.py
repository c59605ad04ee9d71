"""Track the masters and observers of a slave: presence, clock offsets, ranks; serve last messages to late joiners.

Loaded after the vehicle is ready. Until then all senders of commands count as anonymous.
"""

import os
import signal
import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from hil.common.clock import NS_PER_MS, NS_PER_S, now_ns, to_wall_ns
from hil.common.errors import NetworkError
from hil.network.clock_offset import ClockOffset
from hil.network.presence import declare_presence, serve_last, watch_presence
from hil.network.session import Session
from hil.network.settings import Network
from hil.network.supervisor import Supervisor
from hil.network.tokens import PING, PONG, NodeRole, Presence, clock_keys, read_clock
from hil.ros.diagnostics import Diagnostics
from hil.slave.command_receiver import CommandReceiver
from hil.slave.sample_publisher import SamplePublisher

if TYPE_CHECKING:
    from hil.network.security import Security

WAITING = 16  # size of the queue for masters' pings; the queue for all other pings has half of it
MAX_PEERS = 32  # masters and observers, each, that are tracked; further ones are not reported
NEW_NS = 3 * NS_PER_S  # during this time after its start, a slave ends if an older slave has the same name
FIRST_NS = NS_PER_S // 5  # a slave that is found this soon after our start was there before us
TWIN_S = 1.5  # the other slave must stay present for this time; after a kill, its lease of 1 s keeps it present
PINGS_A_S = 200  # rate limit of answers to pings, masters' excepted; enough for all observers


class Contacts:
    """Track presence and clocks of the senders of a command receiver, and announce the vehicle to them.

    `conflict` is set if another slave with the same name was there first; this process then sends itself SIGTERM.
    """

    def __init__(
        self,
        session: Session,
        node: str,
        command_receiver: CommandReceiver,
        sample_publisher: SamplePublisher,
        report: Callable[[str], None],
        security: "Security | None",
        lease: float = Network().lease,
    ) -> None:
        self._command_receiver = command_receiver
        self._supervisor = Supervisor(session, lease)
        self._security = security
        self._report = report
        self._peers: dict[NodeRole, dict[str, Presence]] = {"master": {}, "observer": {}}
        # The ident begins with the start time: of two slaves that start together, the younger has the larger ident.
        self._node, self._ident = node, f"{time.time_ns():016x}{os.urandom(8).hex()}"
        self._twins: set[str] = set()  # idents of other slaves with our name
        self._began_ns = now_ns()
        self.conflict: NetworkError | None = None
        self.lost = 0
        ping, pong, masters_ping = clock_keys(node)
        self._answer = session.sender(pong)
        self._pings = (
            session.receive(ping, self._on_ping, WAITING // 2, PINGS_A_S),
            session.receive(masters_ping, self._on_masters_ping, WAITING),
        )
        session.free_links()
        if security:
            from hil.network.workarounds.accept_queue import shorten_queues

            shorten_queues()
        serve_last(session, node, sample_publisher.encode_unsent)
        watch_presence(session, node, self._on_presence)
        declare_presence(session, node, "slave", self._ident)

    def close_unread_links(self) -> None:
        """Close links that the network library keeps open without reading them; their masters then connect again."""
        if self._supervisor.close_faulty_links():
            self._report("a link was open and not read, or lost: its master has to connect again")

    def add_figures(self, figures: Diagnostics) -> None:
        """Add the masters present, the active master, and the offset of its clock to the diagnostics."""
        command_receiver = self._command_receiver
        masters = list(self._peers["master"].values())
        if self._security:
            figures.may_command, figures.may_listen = self._security.may_command, self._security.may_listen
        figures.commanded_by = "" if command_receiver.is_master_timed_out else command_receiver.master.hex()
        figures.commander = " ".join(
            [master.process for master in masters if master.ident == command_receiver.master.hex()]
        )
        figures.masters = tuple([master.process for master in masters])
        figures.observers = len(self._peers["observer"])
        figures.masters_lost = self.lost
        figures.pings_dropped = sum([pings.lost for pings in self._pings])
        clock = command_receiver.clocks.get(command_receiver.master)
        estimate = clock.at(to_wall_ns(now_ns())) if clock else None
        if clock and estimate:
            figures.clock_offset_ms = estimate.offset_ns / NS_PER_MS
            figures.clock_uncertainty_ms = estimate.uncertainty_ns / NS_PER_MS
            figures.clock_drift_ppm = estimate.drift * 1e6
            figures.clock_steps = clock.steps

    def _on_presence(self, presence: Presence, alive: bool) -> None:
        if presence.role == "slave":
            self._on_slave(presence, alive)
            return
        peers = self._peers[presence.role]
        if alive:
            known = len(peers) < MAX_PEERS or presence.ident in peers
            if known:
                peers[presence.ident] = presence
        else:
            known = peers.pop(presence.ident, None) is not None
        if known and presence.role == "master":
            self._on_master(presence, alive)

    def _on_slave(self, presence: Presence, alive: bool) -> None:
        """Handle another slave with our name. A master would command both, so the younger one ends."""
        if not alive:
            self._twins.discard(presence.ident)
        elif presence.ident != self._ident and len(self._twins) < MAX_PEERS:
            self._twins.add(presence.ident)
            age_ns = now_ns() - self._began_ns
            apart_ns = abs(int(presence.ident[:16], 16) - int(self._ident[:16], 16))
            was_first = age_ns < FIRST_NS and apart_ns > NEW_NS  # with closer start times both slaves would end
            is_younger = was_first or (age_ns < NEW_NS and presence.ident < self._ident)
            check = threading.Timer(TWIN_S, self._end_younger, (presence, is_younger))
            check.daemon = True
            check.start()

    def _end_younger(self, other: Presence, is_younger: bool) -> None:
        if other.ident not in self._twins:
            return
        problem = f"another slave named {self._node} is connected: {other.process}"
        if not is_younger:
            self._report(f"WARNING: {problem}; masters command neither of them until one has ended")
            return
        self.conflict = NetworkError(f"{problem}; end that one, or give this one another node in [slave]")
        os.kill(os.getpid(), signal.SIGTERM)

    def _on_master(self, presence: Presence, alive: bool) -> None:
        sender = bytes.fromhex(presence.ident)
        if alive:
            self._command_receiver.ranks[sender] = presence.rank
            rank = f" with rank {presence.rank}" if presence.rank else ""
            self._report(f"master {presence.process} is connected{rank}")
        else:
            was_active = sender == self._command_receiver.master
            self._command_receiver.remove_sender(sender)
            self.lost += 1
            self._report(f"master {presence.process} is lost" + (", which commanded" if was_active else ""))

    def _on_ping(self, payload: bytes) -> None:
        """Answer a ping at once."""
        received_ns = to_wall_ns(now_ns())
        ping = self._read(payload)
        if ping:
            self._send_time(ping[0], ping[1], received_ns)

    def _on_masters_ping(self, payload: bytes) -> None:
        """Answer a master's ping, or use the second half of the exchange that our answer began."""
        received_ns = to_wall_ns(now_ns())
        ping = self._read(payload)
        if ping:
            sender, sent, answered, answer_received = ping
            if answered:
                self._clock_of(sender).add(answered, answer_received, sent, received_ns)
            else:
                self._send_time(sender, sent, received_ns)

    def _send_time(self, sender: bytes, sent: int, received_ns: int) -> None:
        clock = self._command_receiver.clocks.get(sender)
        estimate = clock.at(received_ns) if clock else None
        values = estimate if estimate else (0, -1, 0.0)
        self._answer(PONG.pack(sender, sent, received_ns, to_wall_ns(now_ns()), *values))

    def _read(self, payload: bytes) -> tuple[Any, ...] | None:
        ping = read_clock(PING, payload)
        self._command_receiver.malformed += ping is None
        return ping

    def _clock_of(self, sender: bytes) -> ClockOffset:
        clocks = self._command_receiver.clocks
        if sender not in clocks:
            while len(clocks) >= MAX_PEERS:  # a flood of anonymous senders must not remove the active master
                del clocks[next(other for other in clocks if other != self._command_receiver.master)]
            clocks[sender] = ClockOffset()
        return clocks[sender]
