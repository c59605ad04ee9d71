"""Peers of a vehicle, without a network: which are announced, answered, reported, and which of two slaves ends."""

import os
import threading
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any, cast

import pytest

from hil.common.clock import NS_PER_S, now_ns, to_wall_ns
from hil.network.clock_offset import ClockOffset
from hil.network.tokens import PING, PONG, NodeRole, Presence, clock_keys
from hil.ros.diagnostics import Diagnostics
from hil.slave import contacts as module
from hil.slave.command_receiver import CommandReceiver
from hil.slave.contacts import FIRST_NS, MAX_PEERS, NEW_NS, TWIN_S, Contacts

FIRST, SECOND, LAST = bytes(range(16)), bytes(16), (1 << 63) - 1
CLOCK = SimpleNamespace(at=lambda _: SimpleNamespace(offset_ns=3e6, uncertainty_ns=2e6, drift=5e-6), steps=7)


class Bed:
    """Contacts whose network is the test; their clock stands until a test sets `now`."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.handlers, self.answers, self.lines = dict[str, Any](), list[Any](), list[str]()
        self.now, self.signals, self.checks, self.timers = now_ns(), list[int](), list[Any](), list[Any]()
        session: Any = SimpleNamespace(receive=self._receive)
        session.sender, session.free_links = lambda _: self.answers.append, lambda: self.lines.append("freed")
        for name in ("serve_last", "watch_presence", "declare_presence", "Supervisor"):
            monkeypatch.setattr(module, name, lambda *_: SimpleNamespace(close_faulty_links=lambda: 1))
        monkeypatch.setattr(module, "now_ns", lambda: self.now)
        monkeypatch.setattr(os, "kill", lambda _, number: self.signals.append(number))
        monkeypatch.setattr(threading, "Timer", self._timer)
        self.receiver = CommandReceiver(NS_PER_S)
        publisher: Any = SimpleNamespace(encode_unsent=None)
        security: Any = SimpleNamespace(may_command=("pilot",), may_listen=("guest",))
        monkeypatch.setattr("hil.network.workarounds.accept_queue.shorten_queues", lambda: self.lines.append("short"))
        self.contacts = Contacts(session, "uuv1", self.receiver, publisher, self.lines.append, security)

    def _receive(self, key: str, handler: Any, size: int, *rate: int) -> Any:
        self.handlers[key] = handler
        return SimpleNamespace(lost=size)

    def _timer(self, seconds: float, check: Any, arguments: Any) -> Any:
        assert seconds == TWIN_S
        self.timers.append(SimpleNamespace(start=lambda: self.checks.append(lambda: check(*arguments))))
        return self.timers[-1]

    def meet(self, role: NodeRole, ident: str, alive: bool = True, rank: int = 0) -> None:
        self.contacts._on_presence(Presence("uuv1", role, rank, ident, f"pc:{ident[:4]}"), alive)

    @property
    def figures(self) -> Diagnostics:
        figures = Diagnostics()
        self.contacts.add_figures(figures)
        return figures


@pytest.fixture
def bed(monkeypatch: pytest.MonkeyPatch) -> Iterator[Bed]:
    made = Bed(monkeypatch)
    yield made
    made.receiver.close()


def test_masters_come_with_their_rank_and_go_with_their_state(bed: Bed) -> None:
    assert (bed.lines, bed.figures.commanded_by) == (["freed", "short"], "")
    bed.meet("master", FIRST.hex(), rank=2)
    bed.meet("master", SECOND.hex())
    bed.meet("observer", FIRST.hex())  # with the ident of a master, which it does not replace
    assert bed.receiver.ranks == {FIRST: 2, SECOND: 0}
    bed.receiver.master, bed.receiver._accepted_ns = FIRST, now_ns() + NS_PER_S
    bed.receiver.clocks = {FIRST: ClockOffset()}
    assert bed.figures.clock_offset_ms is None, "there was no exchange yet"
    bed.receiver.clocks = {FIRST: cast(Any, CLOCK)}
    figures = bed.figures
    assert (figures.commanded_by, figures.commander, figures.observers) == (FIRST.hex(), "pc:0001", 1)
    assert (figures.masters, figures.masters_lost, figures.pings_dropped) == (("pc:0001", "pc:0000"), 0, 24)
    assert (figures.may_command, figures.may_listen) == (("pilot",), ("guest",))
    assert (figures.clock_offset_ms, figures.clock_uncertainty_ms, figures.clock_steps) == (3.0, 2.0, 7)
    assert figures.clock_drift_ppm == pytest.approx(5.0)
    bed.meet("observer", FIRST.hex(), alive=False)
    assert bed.figures.commander == "pc:0001"
    for ident in (SECOND.hex(), FIRST.hex()):
        bed.meet("master", ident, alive=False)
    assert (bed.receiver.ranks, bed.receiver.clocks, bed.receiver.master) == ({}, {}, b"")
    assert (bed.figures.masters, bed.figures.observers, bed.figures.masters_lost) == ((), 0, 2)
    bed.contacts.close_unread_links()
    came, plain, gone, active, unread = bed.lines[2:]
    assert (came, plain) == ("master pc:0001 is connected with rank 2", "master pc:0000 is connected")
    assert (gone, active) == ("master pc:0000 is lost", "master pc:0001 is lost, which commanded")
    assert "not read" in unread
    for alive in (True, False):
        for number in range(2 * MAX_PEERS):
            bed.meet("master", f"{number:032x}", alive)
        assert len(bed.receiver.ranks) == len(bed.figures.masters or ()) == alive * MAX_PEERS
    assert len(bed.lines) == 7 + 2 * MAX_PEERS, "an outsider who announces thousands does not fill the log"


def test_pings_are_answered_and_the_second_half_of_an_exchange_sets_the_clock(bed: Bed) -> None:
    ping, _, masters_ping = (bed.handlers.get(key) for key in clock_keys("uuv1"))
    assert ping
    assert masters_ping
    now = to_wall_ns(bed.now)
    for handle in (ping, masters_ping):
        handle(PING.pack(FIRST, 5, 0, 0))
        assert PONG.unpack(bed.answers.pop()) == (FIRST, 5, now, now, 0, -1, 0.0)
        for times in ((LAST, -LAST, LAST), (-LAST, 0, 0), (0, LAST, 0)):
            handle(PING.pack(FIRST, *times))
        handle(b"?")
    assert (bed.answers, bed.receiver.malformed, bed.receiver.clocks) == ([], 8, {}), "impossible times are none"
    masters_ping(PING.pack(FIRST, now + 1010, now - 20, now + 1000))  # its clock is ahead by this
    assert bed.answers == [], "an exchange ends there"
    assert bed.receiver.clocks[FIRST].at(now).offset_ns == 1015  # type: ignore[union-attr]
    ping(PING.pack(FIRST, 6, 7, 8))  # as an observer sends it, who sets no clock
    assert bed.receiver.clocks[FIRST].steps == 0
    assert PONG.unpack(bed.answers.pop())[:5] == (FIRST, 6, now, now, 1015)
    bed.receiver.master = FIRST
    for number in range(1, 2 * MAX_PEERS):  # a flood of anonymous senders does not remove it
        masters_ping(PING.pack(number.to_bytes(16, "big"), now, now, now))
    assert (len(bed.receiver.clocks), FIRST in bed.receiver.clocks) == (MAX_PEERS, True)


@pytest.mark.parametrize(
    ("age_ns", "ahead_ns", "ends"),
    [
        (0, -1, True), (0, 1, False), (NEW_NS - 1, -1, True), (NEW_NS, -1, False), (NEW_NS - 1, 1, False),
        (FIRST_NS - 1, NEW_NS + 1, True), (FIRST_NS - 1, NEW_NS, False), (FIRST_NS, NEW_NS + 1, False),
    ],
)  # fmt: skip
def test_of_two_slaves_of_a_name_the_younger_ends(bed: Bed, age_ns: int, ahead_ns: int, ends: bool) -> None:
    """One that is there at our start was first, even if its clock is ahead."""
    own = bed.contacts._ident
    other = f"{int(own[:16], 16) + ahead_ns:016x}{own[16:]}"
    bed.now += age_ns
    for ident in (own, other):
        bed.meet("slave", ident)
    (check,) = bed.checks
    assert bed.timers[0].daemon, "the end of the slave does not wait for it"
    bed.meet("slave", other, alive=False)
    check()
    assert (bed.contacts.conflict, bed.lines[2:]) == (None, []), "it has gone"
    bed.meet("slave", other)
    check()
    assert (bed.contacts.conflict is not None, len(bed.signals), len(bed.lines[2:])) == (ends, ends, not ends)
    for number in range(2 * MAX_PEERS):
        bed.meet("slave", f"{number:032x}")
    assert len(bed.contacts._twins) == MAX_PEERS
