"""Thrusters on DroneCAN: our host and our device, record to record."""

from typing import Any, cast

import pytest

from firmware_stub.stub import Stm32, Stm32End
from hil.common.errors import ConfigError
from hil.links.can_thrusters import MotorValues
from hil.links.contract import MAX_THRUSTERS, PWM_NEUTRAL_US, Protocol, ThrusterCommand, ThrusterLink, ThrusterTelemetry
from hil.links.dronecan import types
from hil.links.dronecan.allocation import (
    FOLLOWUP_DELAY_NS,
    FOLLOWUP_TIMEOUT_NS,
    MAX_DYNAMIC_ID,
    REQUEST_PERIOD_NS,
    Allocatee,
    Allocator,
)
from hil.links.dronecan.device import DroneCanDevice
from hil.links.dronecan.host import DroneCanHost
from hil.links.dronecan.link import open_dronecan
from hil.links.dronecan.node import STATUS_PERIOD_NS
from hil.links.dronecan.transfer import DataType, Receiver, Transfer, message_key
from hil.links.dronecan.types import (
    Allocation,
    BatteryInfo,
    EscStatus,
    NodeStatus,
    unpack_esc_status,
    unpack_node_status,
)
from hil.links.protocols import Role
from hil.links.wires.can_frame import CanFrame, unpack_frames
from tests.support.can_bench import MemoryBus, VirtualCanContract, exchange, frames, noise, records
from tests.support.can_pairs import socket_pair
from tests.support.link_contract import CanLinkContract

PULSES = (1100, 1499, 1500, 1501, 1777, 1900)
NEUTRAL = (PWM_NEUTRAL_US,) * 6
MS = 1_000_000


def host(channels: int = 6, **settings: Any) -> DroneCanHost:
    return cast("DroneCanHost", open_dronecan("host", channels, **settings))


def device(channels: int = 6, **settings: Any) -> DroneCanDevice:
    return cast("DroneCanDevice", open_dronecan("device", channels, **settings))


def report(pulses: tuple[int, ...] = PULSES, **changes: Any) -> ThrusterTelemetry:
    return ThrusterTelemetry(0, True, False, pulses, 0, 0, 0, 0)._replace(**changes)


def transfers(output: bytes, kind: DataType) -> list[Transfer]:
    """The messages of a kind in some records."""
    receiver = Receiver(device().counters)
    receiver.kinds = {message_key(kind): kind}
    taken = [receiver.feed_frame(frame, 0) for frame in frames(output)]
    return [whole for whole in taken if whole is not None]


class Board:
    """A host and an STM32 on a bus in memory, with one clock."""

    def __init__(self, channels: int = 6, host_settings: Any = None, **settings: Any) -> None:
        self.bus = MemoryBus()
        self.host = ThrusterLink(self.bus.wire(), host(channels, **(host_settings or {})))
        self.stm32 = Stm32(channels)
        self.end = Stm32End(self.stm32, ThrusterLink(self.bus.wire(), device(channels, **settings)))
        self.now_ns = 0
        self.received: list[ThrusterTelemetry] = []

    def run(self, seconds: float, step_ns: int = 5 * MS) -> None:
        for _ in range(max(1, round(seconds * 1e9 / step_ns))):
            self.now_ns += step_ns
            self.host.tick(self.now_ns)
            self.end.service(self.now_ns)
            self.received += cast("list[ThrusterTelemetry]", self.host.receive())


@pytest.mark.parametrize("channels", range(1, MAX_THRUSTERS + 1))
def test_a_command_crosses_exactly(channels: int) -> None:
    sender, receiver = host(channels), device(channels)
    for sequence in range(801):
        pulses = tuple(1100 + (sequence + 7 * i) % 801 for i in range(channels))
        received = exchange(sender, ThrusterCommand(sequence, True, pulses), receiver)
        assert received == [ThrusterCommand(0, True, pulses)]
    assert receiver.counters.malformed == receiver.counters.checksum_errors == 0


@pytest.mark.parametrize("full_rpm", [800, 3500, 74_000])
def test_a_report_crosses_exactly(full_rpm: float) -> None:
    sender, receiver = device(3, full_rpm=full_rpm), host(3, full_rpm=full_rpm)
    for pulse in range(800, 2201):
        pulses = (pulse, 3000 - pulse, 1500)
        received = exchange(sender, report(pulses, errors=70_000, watchdog_trips=9), receiver)
        assert received == [report(pulses, errors=70_000 & 0xFFFF, watchdog_trips=9)]


def test_what_cannot_be_said_is_the_nearest() -> None:
    (received,) = exchange(host(), ThrusterCommand(1, True, (0, 800, 2200, 1901, 65535, 1099)), device())
    assert received == ThrusterCommand(0, True, (1500, 1100, 1900, 1900, 1500, 1100))


def test_sequence_and_frames_are_inferred() -> None:
    end, master = device(), host()
    for sequence in (65_534, 65_535, 0, 1):
        pulses = (1600 + sequence % 100, *PULSES[1:])
        (command,) = exchange(master, ThrusterCommand(sequence, True, pulses), end)
        assert isinstance(command, ThrusterCommand)
        (answer,) = exchange(end, report(command.pwm_us), master)
        assert isinstance(answer, ThrusterTelemetry)
        assert (answer.sequence, answer.pwm_us) == (sequence, pulses)
        assert answer.frames == (sequence + 3) & 0xFFFF
    (again,) = exchange(end, report(command.pwm_us), master)
    assert again == answer, "the same report answers no new command"


def test_clamped_commands_are_answered_too() -> None:
    end, master = device(1), host(1)
    for sequence, pulse in enumerate((0, 1000, 2100, 1700), 5):
        (command,) = exchange(master, ThrusterCommand(sequence, True, (pulse,)), end)
        (answer,) = exchange(end, report(command.pwm_us), master)
        assert isinstance(answer, ThrusterTelemetry)
        assert answer.sequence == sequence


def test_arming() -> None:
    end, master = device(), host()
    armed, disarmed = ThrusterCommand(1, True, PULSES), ThrusterCommand(2, False, PULSES)
    assert exchange(master, disarmed, end) == [ThrusterCommand(0, False, NEUTRAL)]
    assert not transfers(master.encode(disarmed), types.ARMING_STATUS), "only changes are said at once"
    assert exchange(master, armed, end) == [ThrusterCommand(0, True, PULSES)]
    ended = exchange(master, disarmed, end)
    assert ended == [ThrusterCommand(0, False, NEUTRAL)] * 2, "one from ArmingStatus, one from RawCommand"


def test_a_host_that_knows_no_arming() -> None:
    """As AM32 with REQUIRE_ARMING 1 and 0."""
    master = host()
    raw_only = records(f for f in frames(master.encode(ThrusterCommand(1, True, PULSES))) if f.id >> 8 & 0xFFFF == 1030)
    assert device().feed(raw_only) == [ThrusterCommand(0, False, PULSES)]
    assert device(require_arming=False).feed(raw_only) == [ThrusterCommand(0, True, PULSES)]
    obeying_nobody = device(require_arming=False)
    assert obeying_nobody.feed(master._arming()) == []


def test_arming_status_is_repeated() -> None:
    board = Board()
    board.host.send(ThrusterCommand(1, True, PULSES))
    output: list[bytes] = []
    board.bus.taps.append(output.append)
    board.run(3.0)
    repeated = transfers(b"".join(output), types.ARMING_STATUS)
    assert [transfer.payload for transfer in repeated] == [b"\xff"] * 6
    assert {transfer.source for transfer in repeated} == {10}


def test_short_and_long_commands() -> None:
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


def test_nodes_say_once_a_second_that_they_live() -> None:
    board = Board()
    output: list[bytes] = []
    board.bus.taps.append(output.append)
    board.run(5.0)
    status = transfers(b"".join(output), types.NODE_STATUS)
    for source in (10, 20):
        uptimes = [s.uptime_s for t in status if t.source == source and (s := unpack_node_status(t.payload))]
        assert uptimes == [0, 1, 2, 3, 4]


def test_esc_status_is_filled() -> None:
    def values(thruster: int, pulse_us: int) -> MotorValues:
        return MotorValues(12.5, thruster + pulse_us / 1000, 280.0 + thruster)

    output = device(2, motor_values=values, full_rpm=4000).encode(report((1500, 1700), errors=3))
    status = [unpack_esc_status(transfer.payload) for transfer in transfers(output, types.ESC_STATUS)]
    assert status[0] == EscStatus(3, 12.5, 1.5, 280.0, 0, 0, 0)
    assert status[1] is not None
    assert status[1]._replace(current_a=0) == EscStatus(3, 12.5, 0, 281.0, 2000, 12, 1)
    assert status[1].current_a == pytest.approx(2.7, rel=1e-3)
    own = [unpack_esc_status(t.payload) for t in transfers(device(2).encode(report((1100, 1900))), types.ESC_STATUS)]
    assert [(s.rpm, s.current_a, s.power_pct) for s in own if s] == [(-3500, 24.0, 100), (3500, 24.0, 100)]


@pytest.mark.parametrize("lost", range(18))
def test_a_lost_frame_never_mixes_two_reports(lost: int) -> None:
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


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 1), (2, 1, 0), (1, 0, 2)])
@pytest.mark.parametrize("rare", [None, 0, 1, 2])
def test_controllers_in_any_order_and_at_different_rates(order: tuple[int, ...], rare: int | None) -> None:
    master = host(3, own_device=False)
    single = [device(1, node_id=30 + index) for index in range(3)]
    reported = []
    for count in range(40):
        for index in order:
            if index != rare or count % 4 == 0:
                status = single[index]._esc_status(index, 1500 + 100 * index + count, 0)
                output = single[index]._broadcast(types.ESC_STATUS, 16, types.pack_esc_status(status))
                reported += [cast("ThrusterTelemetry", message).pwm_us for message in master.feed(output)]
    assert len(reported) >= 9
    for pulses in reported:
        ages = [pulse - 100 * index for index, pulse in enumerate(pulses)]
        assert max(ages) - min(ages) <= 4, "of about the same time"
    assert reported[-1][0] >= 1535


def test_others_controllers_are_let_be() -> None:
    end, master = device(6), host(2)
    assert exchange(end, report(), master) == [report(PULSES[:2])]


def test_a_foreign_controller_is_believed_as_far_as_it_goes() -> None:
    end, master = device(), host(own_device=False)
    exchange(master, ThrusterCommand(7, True, PULSES), end)
    assert exchange(end, report(armed=False), master) == [report(PULSES, sequence=7, frames=1)]
    (off,) = exchange(end, report(tuple(p + 1 for p in PULSES)), master)
    assert isinstance(off, ThrusterTelemetry)
    assert (off.sequence, off.pwm_us) == (7, tuple(p + 1 for p in PULSES))


def test_the_stm32_on_the_bus() -> None:
    board = Board()
    board.run(0.1)
    assert board.received
    assert not any(t.armed or t.timed_out for t in board.received)
    for sequence in range(1, 21):
        board.host.send(ThrusterCommand(sequence, True, (1500 + sequence,) * 6))
        board.run(0.02)
        last = board.received[-1]
        assert last == ThrusterTelemetry(sequence, True, False, (1500 + sequence,) * 6, 0, sequence, 0, 0)
    board.run(0.3)
    assert board.received[-1] == last._replace(armed=False, timed_out=True, pwm_us=NEUTRAL, watchdog_trips=1)
    assert board.stm32.watchdog_trips == 1
    board.host.send(ThrusterCommand(21, True, PULSES))
    board.run(0.02)
    assert board.received[-1] == ThrusterTelemetry(21, True, False, PULSES, 0, 21, 0, 1)
    board.host.send(ThrusterCommand(22, False, PULSES))
    board.run(0.02)
    assert (board.received[-1].armed, board.received[-1].pwm_us) == (False, NEUTRAL)
    for link in (board.host, board.end.link):
        assert (link.counters.malformed, link.counters.checksum_errors, link.counters.dropped_bytes) == (0, 0, 0)


def test_battery_info() -> None:
    board = Board(battery={"voltage_v": 14.75, "state_of_charge_pct": 42}, battery_period=0.5)
    output: list[bytes] = []
    board.bus.taps.append(output.append)
    board.run(2.0)
    assert len(transfers(b"".join(output), types.BATTERY_INFO)) == 4
    assert cast("DroneCanHost", board.host.protocol).battery == BatteryInfo(voltage_v=14.75, state_of_charge_pct=42)
    measured = iter(range(15, 99))
    board = Board(battery_values=lambda: BatteryInfo(voltage_v=next(measured)))
    board.run(2.9)
    assert cast("DroneCanHost", board.host.protocol).battery == BatteryInfo(voltage_v=17)


@pytest.mark.parametrize("preferred", [0, 33])
def test_our_allocator_gives_our_device_a_number(preferred: int) -> None:
    board = Board(node_id=0, preferred_node_id=preferred, host_settings={"allocate": True})
    anonymous = cast("DroneCanDevice", board.end.link.protocol)
    assert anonymous.encode(report()) == b""
    board.run(4.0)
    assert anonymous.node_id == (preferred or MAX_DYNAMIC_ID)
    board.host.send(ThrusterCommand(9, True, PULSES))
    board.run(0.03)
    assert board.received[-1] == ThrusterTelemetry(9, True, False, PULSES, 0, 1, 0, 0)


def test_the_allocatee_keeps_the_rules() -> None:
    unique_id = bytes(range(16))
    drawn = [0.0]
    asking = Allocatee(unique_id, 5, lambda: drawn[0])

    def next_request(now_ns: int) -> tuple[int, Allocation]:
        request = asking.request(now_ns)
        assert request is None, "the delay is drawn first"
        assert asking.request(asking.due_ns - 1) is None
        at_ns = asking.due_ns
        request = asking.request(at_ns)
        assert request is not None
        return at_ns, request

    assert next_request(0) == (REQUEST_PERIOD_NS[0], Allocation(5, True, unique_id[:6]))
    drawn[0] = 0.5
    asking.on_allocation(0, Allocation(0, True, b"other!"))  # rule C
    assert next_request(1000) == (1000 + sum(REQUEST_PERIOD_NS) // 2, Allocation(5, True, unique_id[:6]))
    asking.on_allocation(99, Allocation(0, False, unique_id[:6]))  # rule D
    assert next_request(2000) == (2000 + sum(FOLLOWUP_DELAY_NS) // 2, Allocation(5, False, unique_id[6:12]))
    asking.on_allocation(99, Allocation(0, False, b"\xff" + unique_id[1:6]))
    assert next_request(3000)[1].first_part, "the answer was another's"
    asking.on_allocation(99, Allocation(0, False, unique_id[:12]))
    assert next_request(4000)[1] == Allocation(5, False, unique_id[12:])
    asking.on_allocation(99, Allocation(0, False, unique_id))
    assert asking.node_id == 0
    asking.on_allocation(0, Allocation(9, False, unique_id))
    assert asking.node_id == 0, "who is anonymous gives no numbers"
    asking.on_allocation(99, Allocation(7, False, unique_id))
    assert asking.node_id == 7  # rule E


def ask(allocator: Allocator, unique_id: bytes, preferred: int = 0) -> int:
    parts = [unique_id[:6], unique_id[6:12], unique_id[12:]]
    answers = [allocator.answer(Allocation(preferred, not i, part)) for i, part in enumerate(parts)]
    *first, last = answers
    assert first == [Allocation(0, False, unique_id[:6]), Allocation(0, False, unique_id[:12])]
    if last is None:
        return 0
    assert last.unique_id == unique_id
    return last.node_id


def test_the_allocator_gives_each_its_own() -> None:
    allocator = Allocator()
    allocator.see(125)
    allocator.see(50)
    uids = [bytes([number]) * 16 for number in range(1, 130)]
    assert ask(allocator, uids[0]) == 124
    assert ask(allocator, uids[1], 50) == 51
    assert ask(allocator, uids[2], 124) == 123
    assert ask(allocator, uids[0], 99) == 124, "the same node again"
    rest = [ask(allocator, uid, 1) for uid in uids[3:]]
    assert sorted(filter(None, rest)) == sorted(set(range(1, 126)) - {125, 50, 124, 51, 123})
    assert rest[-1] == 0


def test_the_allocator_forgets_half_an_exchange() -> None:
    allocator = Allocator()
    assert allocator.answer(Allocation(0, False, b"6bytes")) is None
    assert allocator.answer(Allocation(0, True, b"short")) is None
    assert allocator.answer(Allocation(0, True, b"abcdef"))
    allocator.expire(1000)
    assert allocator.due_ns == 1000 + FOLLOWUP_TIMEOUT_NS
    allocator.expire(allocator.due_ns)
    assert allocator.answer(Allocation(0, False, b"ghijkl")) is None


@pytest.mark.parametrize(
    ("role", "channels", "settings", "words"),
    [
        ("host", 17, {}, "1 to 16 thrusters"),
        ("device", 0, {}, "1 to 16 thrusters"),
        ("host", 6, {"node_id": 0}, "node_id"),
        ("host", 6, {"nodeid": 3}, "node_id"),
        ("device", 6, {"node_id": 128}, "node_id"),
        ("device", 6, {"full_rpm": 100}, "full_rpm"),
        ("device", 6, {"unique_id": "00" * 16}, "unique_id"),
        ("device", 6, {"unique_id": "xyz"}, "unique_id"),
        ("device", 6, {"unique_id": "00 " * 16}, "unique_id"),
        ("device", 6, {"battery": {"volts": 3}}, "volts"),
    ],
)
def test_wrong_settings_are_named(role: Any, channels: int, settings: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        open_dronecan(role, channels, **settings)


def test_a_hundred_thousand_bad_records() -> None:
    end, master = device(node_id=0), host(allocate=True)
    talker = device(battery={})
    sound = frames(host().encode(ThrusterCommand(1, True, PULSES)) + host().tick(0))
    sound += frames(talker.encode(report()) + talker.tick(0) + end.tick(0) + end.tick(10**10))
    sound += [CanFrame(0x1E018A0A, b"\xc0")]  # GetNodeInfo of node 10
    now_ns, received = 0, 0
    for record in noise(100_000, sound):
        received += len(end.feed(record)) + len(master.feed(record))
        master.replies()
        end.replies()
        now_ns += MS
        for node in (end, master):
            if now_ns >= node.deadline_ns:
                node.tick(now_ns)
    assert received > 100
    for node in (end, master):
        assert node.counters.malformed > 100
        assert len(node._receiver._sessions) <= 128 * len(node._receiver.kinds)
    assert len(master._codes) <= 127
    assert len(master._rounds._pulses) <= 6
    master.feed(b"\0" * 5)
    assert master.counters.dropped_bytes == 5


def test_11_bit_frames_are_others() -> None:
    output = host().encode(ThrusterCommand(1, True, PULSES))
    short = records(frame._replace(extended=False, id=frame.id & 0x7FF) for frame in unpack_frames(output))
    assert device().feed(short) == []


def test_what_each_second_of_six_thrusters_takes_of_a_bus() -> None:
    """At 50 Hz, in frames: 2 a command, 3 a status, and little besides."""
    board = Board()
    output: list[bytes] = []
    board.bus.taps.append(output.append)
    for sequence in range(50):
        board.host.send(ThrusterCommand(sequence, True, (1500 + sequence,) * 6))
        board.run(0.02, 20 * MS)
    count = sum(len(frames(data)) for data in output)
    assert count <= 50 * (2 + 18) + 40
    assert STATUS_PERIOD_NS == 10**9


class DroneCan(CanLinkContract):
    """What crosses on DroneCAN."""

    commands_carry = ("armed", "pwm_us")
    reports_carry = ("sequence", "armed", "timed_out", "pwm_us", "frames", "errors", "watchdog_trips")

    def protocol_of(self, role: Role, channels: int) -> Protocol:
        return open_dronecan(role, channels)


class TestDroneCanOnSocketCan(DroneCan):
    open_wires = staticmethod(socket_pair)
    host_sees_hangup = True


class TestDroneCanOnVirtualCan(VirtualCanContract, DroneCan):
    pass
