"""Peers of a vehicle: presence, clocks, and forged or invalid messages."""

import os
import re
import signal
import time
from collections.abc import Iterator
from typing import NamedTuple

import pytest

from hil.client.client import VehicleClient
from hil.common.clock import NS_PER_S, now_ns, to_wall_ns
from hil.network.opening import listen
from hil.network.presence import declare_presence
from hil.network.roles import open_master_session
from hil.network.session import Session
from hil.network.tokens import PING, PONG, clock_keys
from hil.ros.diagnostics import Diagnostics
from hil.slave.command_receiver import CommandReceiver
from hil.slave.contacts import MAX_PEERS, TWIN_S, Contacts
from hil.slave.sample_publisher import SamplePublisher
from tests.support.processes import free_port, wait_for

PING_KEY, PONG_KEY, MASTERS_PING_KEY = clock_keys("uuv1")
LAST, FIRST = (1 << 63) - 1, -(1 << 63)


class Slave(NamedTuple):
    """A vehicle's network session without a slave loop, and a second session that is connected to it."""

    endpoint: str
    command_receiver: CommandReceiver
    contacts: Contacts
    other: Session

    @property
    def output(self) -> Diagnostics:
        """Return the diagnostics that the contacts add now."""
        output = Diagnostics()
        self.contacts.add_figures(output)
        return output


@pytest.fixture
def slave() -> Iterator[Slave]:
    endpoint, command_receiver = f"tcp/127.0.0.1:{free_port()}", CommandReceiver(NS_PER_S)
    with listen(endpoint) as session, open_master_session(endpoint) as other:
        contacts = Contacts(
            session, "uuv1", command_receiver, SamplePublisher(session, "uuv1", 0), lambda _: None, None
        )
        yield Slave(endpoint, command_receiver, contacts, other)
    command_receiver.close()


def ping(ident: bytes, ahead_ns: int) -> bytes:
    """Return a ping of a clock that is ahead, with the times of a reply that it has just received."""
    now = to_wall_ns(now_ns())
    return PING.pack(ident, now + ahead_ns, now - 1_000_000, now + ahead_ns - 100_000)


@pytest.mark.parametrize("key", [PING_KEY, MASTERS_PING_KEY])
def test_pings_with_impossible_times_are_malformed_and_later_ones_are_answered(slave: Slave, key: str) -> None:
    send = slave.other.sender(key)

    def counted() -> int:
        for instants in ((LAST, FIRST, LAST), (FIRST, 0, 0), (0, LAST, 0)):
            send(PING.pack(b"x" * 16, *instants))
        return slave.command_receiver.malformed >= 3

    assert wait_for(counted)
    assert not slave.command_receiver.clocks
    with VehicleClient(slave.endpoint, "uuv1", role="observer") as observer:
        assert observer.contact.known.wait(60)


def test_only_clocks_of_masters_are_stored(slave: Slave) -> None:
    replies: list[bytes] = []
    slave.other.receive(PONG_KEY, replies.append, 16)
    with VehicleClient(slave.endpoint, "uuv1") as master, VehicleClient(slave.endpoint, "uuv1", role="observer") as one:
        ident, ask = master._commands.gid, slave.other.sender(PING_KEY)
        assert one.contact.known.wait(60)
        assert wait_for(lambda: ident in slave.command_receiver.clocks and master.contact.reported)
        assert wait_for(lambda: ask(ping(ident, 3600 * NS_PER_S)) or len(replies) > 20)
        assert {known: clock.steps for known, clock in slave.command_receiver.clocks.items()} == {ident: 0}
        printed = [PONG.unpack(answer)[-3:-1] for answer in replies if answer.startswith(ident)]
    assert all(abs(offset) < NS_PER_S for offset, _ in printed)


def test_many_pings_do_not_remove_the_clock_of_the_active_master(slave: Slave) -> None:
    slave.command_receiver.master = b"m" * 16
    for number in range(3 * MAX_PEERS):
        ident = slave.command_receiver.master if number == 3 else number.to_bytes(16, "big")
        slave.contacts._on_masters_ping(ping(ident, 0))
    assert len(slave.command_receiver.clocks) == MAX_PEERS
    assert slave.command_receiver.master in slave.command_receiver.clocks


def test_an_observer_with_the_ident_of_a_master_does_not_replace_it(slave: Slave) -> None:
    slave.command_receiver.master = bytes.fromhex("ab" * 16)
    declare_presence(slave.other, "uuv1", "master", "ab" * 16)
    assert wait_for(lambda: slave.output.commander)
    name = slave.output.commander
    withdraw = declare_presence(slave.other, "uuv1", "observer", "ab" * 16)
    assert wait_for(lambda: slave.output.observers == 1)
    assert slave.output.masters == (name,)
    withdraw()
    assert wait_for(lambda: slave.output.observers == 0)
    assert slave.output.commander == name


def test_the_number_of_reported_masters_is_limited(slave: Slave) -> None:
    """An outsider announces thousands: neither the log nor the table of ranks grows with them."""
    reported: list[str] = []
    slave.contacts._report = reported.append
    for number in range(3 * MAX_PEERS):
        declare_presence(slave.other, "uuv1", "master", f"{number:032x}")
    assert wait_for(lambda: len(slave.output.masters or ()) == MAX_PEERS, 60)
    slave.other.close()
    assert wait_for(lambda: not slave.output.masters, 60)
    assert len(reported) == 2 * MAX_PEERS
    assert len(slave.command_receiver.ranks) <= MAX_PEERS


def test_a_new_slave_ends_when_its_name_is_in_use(slave: Slave, monkeypatch: pytest.MonkeyPatch) -> None:
    signals: list[int] = []
    monkeypatch.setattr(os, "kill", lambda _, number: signals.append(number))
    declare_presence(slave.other, "uuv1", "slave", "00" * 16)
    assert wait_for(lambda: slave.contacts.conflict is not None, 60)
    assert signals == [signal.SIGTERM]
    assert re.match(r"another slave named uuv1 is connected: .+:\d+; end that one", str(slave.contacts.conflict))


def test_the_younger_of_two_slaves_that_start_together_ends(slave: Slave, monkeypatch: pytest.MonkeyPatch) -> None:
    """The younger ends in whatever order they discover each other."""
    signals: list[int] = []
    monkeypatch.setattr(os, "kill", lambda _, number: signals.append(number))
    monkeypatch.setattr("hil.slave.contacts.FIRST_NS", 3600 * NS_PER_S)
    monkeypatch.setattr("hil.slave.contacts.TWIN_S", 0.0)
    reported: list[str] = []
    slave.contacts._report = reported.append
    began_ns = int(slave.contacts._ident[:16], 16)
    declare_presence(slave.other, "uuv1", "slave", f"{began_ns + NS_PER_S:016x}{16 * '0'}")
    assert wait_for(lambda: bool(reported), 60), "the other is younger"
    assert slave.contacts.conflict is None
    declare_presence(slave.other, "uuv1", "slave", f"{began_ns - NS_PER_S:016x}{16 * '0'}")
    slave.contacts._began_ns = now_ns()
    assert wait_for(lambda: signals == [signal.SIGTERM], 60), "the other is older"


def test_a_running_slave_stays_when_another_of_its_name_starts(slave: Slave) -> None:
    reported: list[str] = []
    slave.contacts._report = reported.append
    slave.contacts._began_ns -= 3600 * NS_PER_S
    declare_presence(slave.other, "uuv1", "slave")
    assert wait_for(lambda: bool(reported), 60)
    assert reported[0].startswith("WARNING: another slave named uuv1 is connected")
    assert slave.contacts.conflict is None


def test_a_slave_that_was_just_killed_is_no_conflict(slave: Slave) -> None:
    leave = declare_presence(slave.other, "uuv1", "slave")
    assert wait_for(lambda: bool(slave.contacts._twins), 60)
    leave()
    assert wait_for(lambda: not slave.contacts._twins, 60)
    time.sleep(TWIN_S + 0.1)
    assert slave.contacts.conflict is None
