"""Thrusters on DroneCAN: our host and our device, record to record."""

import pytest

from hil.common.errors import ConfigError
from hil.links.contract import MAX_THRUSTERS, Protocol, ThrusterCommand, ThrusterTelemetry
from hil.links.dronecan import types
from hil.links.dronecan.link import open_dronecan
from hil.links.dronecan.types import EscStatus, NodeStatus, unpack_esc_status, unpack_node_status
from hil.links.protocols import Role
from tests.support.links.can_bench import VirtualCanContract, exchange, frames, records
from tests.support.links.can_pairs import socket_pair
from tests.support.links.dronecan_ends import NEUTRAL, PULSES, Board, device, host, report, transfers
from tests.support.links.link_contract import CanLinkContract


@pytest.mark.parametrize("channels", range(1, MAX_THRUSTERS + 1))
def test_a_command_is_transferred_exactly(channels: int) -> None:
    sender, receiver = host(channels), device(channels)
    for sequence in range(801):
        pulses = tuple(1100 + (sequence + 7 * i) % 801 for i in range(channels))
        received = exchange(sender, ThrusterCommand(sequence, True, pulses), receiver)
        assert received == [ThrusterCommand(0, True, pulses)]
    assert receiver.counters.malformed == receiver.counters.checksum_errors == 0


@pytest.mark.parametrize("full_rpm", [800, 3500, 74_000])
def test_a_report_is_transferred_exactly(full_rpm: float) -> None:
    sender, receiver = device(3, full_rpm=full_rpm), host(3, full_rpm=full_rpm)
    for pulse in range(800, 2201):
        pulses = (pulse, 3000 - pulse, 1500)
        received = exchange(sender, report(pulses, errors=70_000, watchdog_trips=9), receiver)
        assert received == [report(pulses, errors=70_000 & 0xFFFF, watchdog_trips=9)]


def test_sequence_and_frame_count_are_inferred() -> None:
    end, master = device(), host()
    for sequence in (65_534, 65_535, 0, 1):
        pulses = (1600 + sequence % 100, *PULSES[1:])
        (command,) = exchange(master, ThrusterCommand(sequence, True, pulses), end)
        assert isinstance(command, ThrusterCommand)
        (telemetry,) = exchange(end, report(command.pwm_us), master)
        assert isinstance(telemetry, ThrusterTelemetry)
        assert (telemetry.sequence, telemetry.pwm_us) == (sequence, pulses)
        assert telemetry.frames == (sequence + 3) & 0xFFFF
    (again,) = exchange(end, report(command.pwm_us), master)
    assert again == telemetry, "the same report does not acknowledge a new command"


def test_arming_and_disarming_are_transferred() -> None:
    end, master = device(), host()
    armed, disarmed = ThrusterCommand(1, True, PULSES), ThrusterCommand(2, False, PULSES)
    assert exchange(master, disarmed, end) == [ThrusterCommand(0, False, NEUTRAL)]
    assert not transfers(master.encode(disarmed), types.ARMING_STATUS), "only changes are sent at once"
    assert exchange(master, armed, end) == [ThrusterCommand(0, True, PULSES)]
    ended = exchange(master, disarmed, end)
    assert ended == [ThrusterCommand(0, False, NEUTRAL)] * 2, "one from ArmingStatus, one from RawCommand"


def test_a_host_without_arming_drives_controllers_that_require_none() -> None:
    """The ESC is AM32's, with REQUIRE_ARMING 1 and 0."""
    master = host()
    raw_only = records(f for f in frames(master.encode(ThrusterCommand(1, True, PULSES))) if f.id >> 8 & 0xFFFF == 1030)
    assert device().feed(raw_only) == [ThrusterCommand(0, False, PULSES)]
    assert device(require_arming=False).feed(raw_only) == [ThrusterCommand(0, True, PULSES)]
    unarmed = device(require_arming=False)
    assert unarmed.feed(master._arming()) == []


def test_arming_status_is_repeated() -> None:
    board = Board()
    board.host.send(ThrusterCommand(1, True, PULSES))
    output: list[bytes] = []
    board.bus.taps.append(output.append)
    board.run(3.0)
    repeated = transfers(b"".join(output), types.ARMING_STATUS)
    assert [transfer.payload for transfer in repeated] == [b"\xff"] * 6
    assert {transfer.source for transfer in repeated} == {10}


def test_commands_of_any_length_are_transferred() -> None:
    master = host(8)
    arming_and_raw = master.encode(ThrusterCommand(1, True, (*range(1200, 1900, 100), 1234)))
    assert device(3).feed(arming_and_raw) == [ThrusterCommand(0, True, (1200, 1300, 1400))]
    (command,) = device(10).feed(arming_and_raw)
    assert command.pwm_us == (1200, 1300, 1400, 1500, 1600, 1700, 1800, 1234, 1500, 1500)


def test_node_status_is_sent_at_once_when_arming_changes() -> None:
    end = device()
    assert not transfers(end.encode(report(armed=False)), types.NODE_STATUS)
    (transfer,) = transfers(end.encode(report()), types.NODE_STATUS)
    assert unpack_node_status(transfer.payload) == NodeStatus(0, types.HEALTH_OK, 0, 1)
    assert not transfers(end.encode(report()), types.NODE_STATUS)
    (transfer,) = transfers(end.encode(report(armed=False, timed_out=True, watchdog_trips=3)), types.NODE_STATUS)
    assert unpack_node_status(transfer.payload) == NodeStatus(0, types.HEALTH_WARNING, 0, 2 | 3 << 2)


def test_esc_status_has_its_fields() -> None:
    output = device(2, full_rpm=4000, esc_index=5).encode(report((1500, 1700), errors=3))
    status = [unpack_esc_status(transfer.payload) for transfer in transfers(output, types.ESC_STATUS)]
    assert status == [EscStatus(3, 16.0, 0.0, 288.0, 0, 0, 5), EscStatus(3, 16.0, 3.0, 291.75, 2000, 12, 6)]
    own = [unpack_esc_status(t.payload) for t in transfers(device(2).encode(report((1100, 1900))), types.ESC_STATUS)]
    assert [(s.rpm, s.current_a, s.power_pct) for s in own if s] == [(-3500, 24.0, 100), (3500, 24.0, 100)]


@pytest.mark.parametrize("lost", range(18))
def test_a_lost_frame_never_combines_two_reports(lost: int) -> None:
    end, master = device(), host()
    end.encode(report())
    reported: list[tuple[int, ...]] = []
    for count in range(6):
        cut = frames(end.encode(report((1600 + count,) * 6)))
        assert len(cut) == 18
        if count == 2:
            del cut[lost]
        reported += [message.pwm_us for message in master.feed(records(cut))]
    assert reported == [(1600 + count,) * 6 for count in (0, 1, 3, 4, 5)]


def test_indices_beyond_a_command_are_refused() -> None:
    for end in (host, device):
        end(6, esc_index=14)
        with pytest.raises(ConfigError, match="esc_index: 6 thrusters from 15 on"):
            end(6, esc_index=15)


class DroneCan(CanLinkContract):
    """The parts of commands and reports that DroneCAN carries."""

    commands_carry = ("armed", "pwm_us")
    reports_carry = ("sequence", "armed", "timed_out", "pwm_us", "frames", "errors", "watchdog_trips")

    def protocol_of(self, role: Role, channels: int) -> Protocol:
        return open_dronecan(role, channels)


class TestDroneCanOnSocketCan(DroneCan):
    open_wires = staticmethod(socket_pair)
    host_sees_hangup = True


class TestDroneCanOnVirtualCan(VirtualCanContract, DroneCan):
    pass


def test_transfers_of_a_kind_are_numbered_one_after_the_other() -> None:
    """A receiver counts a gap as lost transfers."""
    master = host(1)
    sent = [frame for n in range(40) for frame in frames(master.encode(ThrusterCommand(n, True, (1600,))))]
    numbers = [frame.data[-1] & 31 for frame in sent if frame.id >> 8 & 0xFFFF == types.RAW_COMMAND.id]
    assert numbers == [number % 32 for number in range(40)]
