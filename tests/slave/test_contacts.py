"""Who is there for a vehicle: whose clocks it knows, and what others say in a master's name or out of all bounds."""

from collections.abc import Iterator
from typing import NamedTuple

import pytest

from hil.clock import NS_PER_S, now_ns, to_wall_ns
from hil.master.client import VehicleClient
from hil.slave.contacts import MOST_THERE, Contacts
from hil.slave.inbox import Inbox
from hil.slave.outbox import Outbox
from hil.transport.presence import declare_presence
from hil.transport.roles import dial
from hil.transport.session import Session, listen
from hil.transport.tokens import PING, PONG, clock_keys
from tests.processes import free_port, wait_for

ASK, ANSWER, MASTERS = clock_keys("uuv1")
LAST, FIRST = (1 << 63) - 1, -(1 << 63)


class Slave(NamedTuple):
    """What there is of a vehicle to get in touch with, and a session that has dialled it."""

    endpoint: str
    inbox: Inbox
    contacts: Contacts
    other: Session


@pytest.fixture
def slave() -> Iterator[Slave]:
    endpoint, inbox = f"tcp/127.0.0.1:{free_port()}", Inbox(NS_PER_S)
    with listen(endpoint) as session, dial(endpoint) as other:
        contacts = Contacts(session, "uuv1", inbox, Outbox(session, "uuv1", 0), lambda _: None, None)
        yield Slave(endpoint, inbox, contacts, other)
    inbox.close()


def ping(ident: bytes, ahead_ns: int) -> bytes:
    """A ping by a clock that is ahead, with an answer that came to it a moment ago."""
    now = to_wall_ns(now_ns())
    return PING.pack(ident, now + ahead_ns, now - 1_000_000, now + ahead_ns - 100_000)


@pytest.mark.parametrize("key", [ASK, MASTERS])
def test_instants_that_cannot_be_are_malformed_and_others_are_served_after_them(slave: Slave, key: str) -> None:
    send = slave.other.sender(key)

    def tell() -> int:
        for instants in ((LAST, FIRST, LAST), (FIRST, 0, 0), (0, LAST, 0)):
            send(PING.pack(b"x" * 16, *instants))
        return slave.inbox.malformed >= 3

    assert wait_for(tell, 3)
    assert not slave.inbox.clocks
    with VehicleClient(slave.endpoint, "uuv1", part="observer") as observer:
        assert observer.contact.known.wait(3)


def test_only_masters_make_their_clocks_known(slave: Slave) -> None:
    answers: list[bytes] = []
    slave.other.receive(ANSWER, answers.append, 16)
    with VehicleClient(slave.endpoint, "uuv1") as master, VehicleClient(slave.endpoint, "uuv1", part="observer") as one:
        ident, ask = master._commands.gid, slave.other.sender(ASK)
        assert one.contact.known.wait(3)
        assert wait_for(lambda: ident in slave.inbox.clocks and master.contact.told, 3)
        assert wait_for(lambda: ask(ping(ident, 3600 * NS_PER_S)) or len(answers) > 20, 3)
        assert {known: clock.steps for known, clock in slave.inbox.clocks.items()} == {ident: 0}
        told = [PONG.unpack(answer)[-3:-1] for answer in answers if answer.startswith(ident)]
    assert all(abs(offset) < NS_PER_S for offset, _ in told)


def test_many_pings_do_not_push_out_the_clock_of_the_one_that_is_obeyed(slave: Slave) -> None:
    slave.inbox.master = b"m" * 16
    for number in range(3 * MOST_THERE):
        ident = slave.inbox.master if number == 3 else number.to_bytes(16, "big")
        slave.contacts._take_masters_ping(ping(ident, 0))
    assert len(slave.inbox.clocks) == MOST_THERE
    assert slave.inbox.master in slave.inbox.clocks


def test_an_observer_with_a_masters_ident_does_not_stand_for_it(slave: Slave) -> None:
    slave.inbox.master = bytes.fromhex("ab" * 16)
    declare_presence(slave.other, "uuv1", "master", "ab" * 16)
    assert wait_for(lambda: slave.contacts.figures()["commander"], 3)
    name = slave.contacts.figures()["commander"]
    withdraw = declare_presence(slave.other, "uuv1", "observer", "ab" * 16)
    assert wait_for(lambda: slave.contacts.figures()["observers"] == "1", 3)
    assert slave.contacts.figures()["masters"] == name
    withdraw()
    assert wait_for(lambda: slave.contacts.figures()["observers"] == "0", 3)
    assert slave.contacts.figures()["commander"] == name
