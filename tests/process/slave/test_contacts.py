"""Forged or invalid pings to a vehicle."""

import pytest

from hil.client.client import VehicleClient
from hil.common.clock import NS_PER_S
from hil.network.opening import listen
from hil.network.roles import open_master_session
from hil.network.tokens import PING, clock_keys
from hil.slave.command_receiver import CommandReceiver
from hil.slave.contacts import Contacts
from hil.slave.sample_publisher import SamplePublisher
from tests.support.processes import free_port, wait_for

PING_KEY, _, MASTERS_PING_KEY = clock_keys("uuv1")
LAST, FIRST = (1 << 63) - 1, -(1 << 63)


@pytest.mark.parametrize("key", [PING_KEY, MASTERS_PING_KEY])
def test_pings_with_impossible_times_are_malformed_and_later_ones_are_answered(key: str) -> None:
    endpoint, receiver = f"tcp/127.0.0.1:{free_port()}", CommandReceiver(NS_PER_S)
    with listen(endpoint) as session, open_master_session(endpoint) as other:
        contacts = Contacts(session, "uuv1", receiver, SamplePublisher(session, "uuv1", 0), print, None)
        send = other.sender(key)

        def counted() -> bool:
            for instants in ((LAST, FIRST, LAST), (FIRST, 0, 0), (0, LAST, 0)):
                send(PING.pack(b"x" * 16, *instants))
            return receiver.malformed >= 3

        assert wait_for(counted)
        assert not receiver.clocks
        with VehicleClient(endpoint, "uuv1") as master, VehicleClient(endpoint, "uuv1", role="observer") as observer:
            assert observer.contact.known.wait(60)
            assert wait_for(lambda: list(receiver.clocks) == [master._commands.gid])
        assert contacts.conflict is None
    receiver.close()
