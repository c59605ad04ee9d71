"""Liveness of a vehicle, and the comparison of its clock with that of a master by pings."""

import time
from collections.abc import Iterator
from unittest.mock import Mock

import pytest

from hil.autonomy.control.controller import VelocityCommand
from hil.client.client import VehicleClient
from hil.client.liveness import LivenessMonitor
from hil.common.clock import NS_PER_S, boot_id, now_ns, to_wall_ns
from hil.common.errors import NetworkError
from hil.network.clock_offset import ClockOffset
from hil.network.opening import listen
from hil.network.presence import declare_presence
from hil.network.roles import open_master_session
from hil.network.session import Session
from hil.network.tokens import PING, PONG, NodeRole, clock_keys
from hil.ros.encoders import encode_diagnostics, pack_attachment
from tests.support.processes import free_port, wait_for

GID = b"m" * 16
PING_KEY, PONG_KEY, MASTERS_PING_KEY = clock_keys("uuv1")


class Vehicle:
    """A vehicle that answers pings by its own clock, `ahead_ns` ns ahead, and records the delay reports of masters.

    `ignores_masters`: pings of masters do not reach it, as if they had no right to command.
    """

    ahead_ns = 5 * NS_PER_S
    ignores_masters = False

    def __init__(self, session: Session) -> None:
        self.pings: list[tuple[int, ...]] = []
        self.ping_roles: list[NodeRole] = []
        self.reported: list[tuple[int, ...]] = []
        self.reply_sender = session.sender(PONG_KEY)
        session.receive(PING_KEY, lambda payload: self._on_ping(payload, "observer"), 16)
        session.receive(MASTERS_PING_KEY, self._take_masters, 16)

    def pong(self, sent_ns: int, vehicle_ns: int) -> bytes:
        return PONG.pack(GID, sent_ns, vehicle_ns, vehicle_ns, 0, 0 if self.reported else -1, 0.0)

    def _take_masters(self, payload: bytes) -> None:
        if self.ignores_masters:
            return
        if PING.unpack(payload)[2]:
            self.reported.append(PING.unpack(payload)[1:])
        else:
            self._on_ping(payload, "master")

    def _on_ping(self, payload: bytes, role: NodeRole) -> None:
        self.ping_roles.append(role)
        self.pings.append(PING.unpack(payload)[1:])
        self.reply_sender(self.pong(self.pings[-1][0], to_wall_ns(time.monotonic_ns()) + self.ahead_ns))


@pytest.fixture
def peers() -> Iterator[tuple[Vehicle, Session]]:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with listen(endpoint) as slave, open_master_session(endpoint) as session:
        yield Vehicle(slave), session


def begin_monitor(session: Session, role: NodeRole) -> tuple[LivenessMonitor, ClockOffset]:
    clock = ClockOffset()
    contact = LivenessMonitor(session, "uuv1", clock, lambda: None, lambda _: None, 0.8)
    contact.begin(role, GID, 0)
    assert contact.known.wait(60)
    return contact, clock


@pytest.mark.parametrize(("role", "reports_replies"), [("master", True), ("observer", False)])
def test_only_a_master_reports_when_each_reply_arrived(
    peers: tuple[Vehicle, Session], role: NodeRole, reports_replies: bool
) -> None:
    vehicle, session = peers
    contact, _ = begin_monitor(session, role)
    assert bool(wait_for(lambda: vehicle.reported, 60 if reports_replies else 0.5)) is reports_replies
    contact.end()
    for sent, answered, came in vehicle.reported:
        assert any(ping <= came <= sent and ping + vehicle.ahead_ns <= answered for ping, *_ in vehicle.pings)


def test_a_master_pings_on_its_own_key_and_as_observer_without_reply(peers: tuple[Vehicle, Session]) -> None:
    vehicle, session = peers
    contact, _ = begin_monitor(session, "master")
    assert wait_for(lambda: contact.reported)
    time.sleep(0.3)  # for pings that are on their way
    before = len(vehicle.ping_roles)
    assert wait_for(lambda: len(vehicle.ping_roles) > before + 3)
    assert set(vehicle.ping_roles[before:]) == {"master"}
    vehicle.ignores_masters = True  # as after a restart with other rights
    vehicle.reported.clear()
    assert wait_for(lambda: contact.losses)
    before = len(vehicle.ping_roles)
    assert wait_for(lambda: contact.present and len(vehicle.ping_roles) > before + 3)
    assert set(vehicle.ping_roles[before:]) == {"observer"}
    assert contact.losses == 1
    contact.end()


def test_replies_to_forged_pings_do_not_change_the_clock_offset(peers: tuple[Vehicle, Session]) -> None:
    vehicle, session = peers
    contact, clock = begin_monitor(session, "master")
    now = to_wall_ns(time.monotonic_ns())
    for sent in (now + 3600 * NS_PER_S, 0, (1 << 63) - 1):
        vehicle.reply_sender(vehicle.pong(sent, now + vehicle.ahead_ns))
        vehicle.reply_sender(vehicle.pong(vehicle.pings[-1][0], (1 << 63) - 1))
    answered = len(vehicle.pings)
    assert wait_for(lambda: len(vehicle.pings) > answered + 1), "it is still there and asks on"
    contact.end()
    found = clock.at(now)
    assert found is not None
    assert abs(found.offset_ns - vehicle.ahead_ns) <= found.uncertainty_ns < NS_PER_S
    assert clock.steps == clock.malformed == 0


@pytest.mark.parametrize("offset_s", [0, -3600, 3600])
def test_sample_ages_are_right_when_the_slave_started_before_its_clock_was_set(offset_s: int) -> None:
    """The board has no real-time clock: its slave started, then its wall clock was set, then this master started."""
    clock, session = ClockOffset(), Mock(spec=Session, has_pairs=True)
    contact = LivenessMonitor(session, "uuv1", clock, lambda: None, print, 1.0)
    contact.same_clock = True
    received = now_ns()
    sent_wall = to_wall_ns(received) + offset_s * NS_PER_S
    clock.add(to_wall_ns(received) - 200_000, sent_wall - 100_000, sent_wall - 90_000, to_wall_ns(received))
    age_ns = received - contact.sent_ns(sent_wall, received)
    assert 0 <= age_ns <= 200_000


@pytest.mark.parametrize("is_here", [True, False], ids=["one machine", "two machines"])
def test_a_restarted_vehicle_with_another_clock_stays_present(peers: tuple[Vehicle, Session], is_here: bool) -> None:
    """Its first messages come before the clocks have been compared again."""
    _, session = peers
    values = {"boot_id": boot_id() if is_here else "another"}
    with VehicleClient(session, "uuv1", role="observer") as client:

        def compare(ahead_ns: int) -> None:
            sent = to_wall_ns(now_ns())
            client.delays.clock.add(sent - 200_000, sent - 100_000 + ahead_ns, sent - 90_000 + ahead_ns, sent)

        def deliver(gid: bytes, ahead_ns: int) -> float:
            sent_ns = to_wall_ns(now_ns()) + ahead_ns
            payload = encode_diagnostics(sent_ns, [("slave", 0, "running", values)])
            client._deliver("diagnostics", payload, pack_attachment(1, sent_ns, gid))
            return client.latest["diagnostics"].age_s

        before_ns, behind_ns = 0 if is_here else 5 * NS_PER_S, -3600 * NS_PER_S
        compare(before_ns)
        assert 0 <= deliver(b"a" * 16, before_ns) < 1
        assert 0 <= deliver(b"b" * 16, behind_ns) < 1, "the clocks have not been compared again"
        compare(behind_ns)
        assert 0 <= deliver(b"b" * 16, behind_ns) < 1
        assert 2 < deliver(b"b" * 16, behind_ns - 3 * NS_PER_S) < 4, "what is old is known as old"


def test_two_slaves_of_one_name_are_not_commanded(peers: tuple[Vehicle, Session]) -> None:
    """Both liveliness tokens exist for longer than that of a killed slave would."""
    _, session = peers
    with VehicleClient(session, "uuv1") as client:
        client.command(VelocityCommand())
        leave = [declare_presence(session, "uuv1", "slave", ident * 16) for ident in ("aa", "bb")]
        assert wait_for(lambda: len(client.contact._slaves) == 2)
        client.contact._doubled_ns -= 10 * NS_PER_S
        assert "all called uuv1" in client.refusal()
        with pytest.raises(NetworkError, match="end one of them"):
            client.command(VelocityCommand(surge=0.5))
        leave[1]()
        assert wait_for(lambda: len(client.contact._slaves) == 1)
        client.command(VelocityCommand(surge=0.5))
