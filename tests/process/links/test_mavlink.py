"""Both ends of a MAVLink link, tested with each other and with plain pymavlink."""

import subprocess
import sys
from itertools import pairwise
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.links.contract import MAX_THRUSTERS, ThrusterCommand, ThrusterTelemetry
from tests.support.links.mavlink_peer import MS, Board, Clock, Peer, device_end, host_end

COMMANDS = ("servo_output_raw", "rc_channels_override")
PULSES = (1100, 1499, 1501, 1900)


def order(sequence: int, pulses: tuple[int, ...] = PULSES, armed: bool = True) -> ThrusterCommand:
    return ThrusterCommand(sequence, armed, pulses)


def report(pulses: tuple[int, ...] = PULSES, **changes: Any) -> ThrusterTelemetry:
    return ThrusterTelemetry(0, False, False, pulses, 0, 0, 0, 0)._replace(**changes)


def reports(messages: list[Any]) -> list[ThrusterTelemetry]:
    assert all(isinstance(message, ThrusterTelemetry) for message in messages)
    return messages


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("channels", [1, 8, 9, MAX_THRUSTERS])
def test_every_pulse_width_is_transmitted_on_every_channel(command: str, channels: int) -> None:
    board, host = Board(channels), host_end(channels, command=command)
    for start in range(1100, 1901, channels):
        pulses = tuple(min(start + i, 1900) for i in range(channels))
        received = reports(host.feed(board.take(host.encode(order(start, pulses)))))
        assert board.pwm_us == list(pulses)
        assert (received[-1].pwm_us, received[-1].sequence, received[-1].armed) == (pulses, start, True)
    assert board.stm32.refused == 0
    assert board.end.counters.malformed == host.counters.dropped_bytes == 0


@pytest.mark.parametrize("command", COMMANDS)
def test_a_width_outside_the_valid_range_turns_the_output_off(command: str) -> None:
    """A width of 0 means that the outputs are off, and must never come out as full astern."""
    board, host = Board(), host_end(command=command)
    board.take(host.encode(order(1)))
    (received,) = reports(host.feed(board.take(host.encode(order(2, (0, 799, 2201, 1600))))))[-1:]
    assert board.pwm_us == [0, 0, 0, 1600]
    assert (received.sequence, received.pwm_us) == (2, (0, 0, 0, 1600))


@pytest.mark.parametrize("command", COMMANDS)
def test_disarmed_outputs_are_neutral_whatever_the_pulses(command: str) -> None:
    board, host = Board(), host_end(command=command)
    host.feed(board.take(host.encode(order(1))))
    assert board.stm32.armed
    (received,) = reports(host.feed(board.take(host.encode(order(2, armed=False)))))[-1:]
    assert not board.stm32.armed
    assert board.pwm_us == [1500] * 4
    assert (received.armed, received.pwm_us, received.sequence) == (False, (1500,) * 4, 2)


def test_arming_is_sent_until_the_device_confirms_it() -> None:
    host, peer, decoder = host_end(), Peer(1, 1), Peer()
    first, second = [decoder.parse(host.encode(order(i))) for i in (1, 2)]
    assert [m.get_type() for m in first] == [m.get_type() for m in second] == ["COMMAND_LONG", "SERVO_OUTPUT_RAW"]
    assert (first[0].command, first[0].param1, first[0].confirmation, second[0].confirmation) == (400, 1.0, 0, 1)
    beat = dialect.MAVLink_heartbeat_message(12, 0, 128, 0, 4, 3)
    assert host.feed(peer.pack(beat)) == []
    assert decoder.names(host.encode(order(3))) == ["SERVO_OUTPUT_RAW"]
    again = decoder.parse(host.encode(order(4, armed=False)))
    assert [m.get_type() for m in again] == ["COMMAND_LONG", "SERVO_OUTPUT_RAW"]
    assert (again[0].param1, again[0].confirmation) == (0.0, 0)
    for _ in range(300):
        unacknowledged = decoder.parse(host.encode(order(5, armed=False)))
    assert unacknowledged[0].confirmation == 255


def test_a_lost_arming_or_tripped_watchdog_is_corrected_by_the_next_command() -> None:
    board, host = Board(), host_end()
    board.take(host.encode(order(1))[-41:])  # the packet of COMPONENT_ARM_DISARM got lost
    assert board.pwm_us == [1500] * 4
    host.feed(board.take(host.encode(order(2))))
    assert board.pwm_us == list(PULSES)
    host.feed(board.wait(201))
    assert not board.stm32.armed
    host.feed(board.take(host.encode(order(3))))
    assert board.stm32.armed
    assert board.pwm_us == list(PULSES)


def test_the_report_shows_the_watchdog_in_the_same_instant() -> None:
    board, host = Board(), host_end()
    host.feed(board.take(host.encode(order(1))))
    (received,) = reports(host.feed(board.wait(200)))
    assert (received.timed_out, received.armed, received.watchdog_trips, received.pwm_us) == (
        True,
        False,
        1,
        (1500,) * 4,
    )
    (received,) = reports(host.feed(board.take(host.encode(order(2)))))[-1:]
    assert (received.timed_out, received.armed, received.watchdog_trips) == (False, True, 1)


def test_an_unchanged_report_is_one_message() -> None:
    device, decoder = device_end(), Peer()
    assert decoder.names(device.encode(report(armed=True))) == ["HEARTBEAT", "SYS_STATUS", "SERVO_OUTPUT_RAW"]
    assert decoder.names(device.encode(report(armed=True, frames=9, errors=3))) == ["SERVO_OUTPUT_RAW"]
    changed = device.encode(report(armed=True, watchdog_trips=2))
    assert decoder.names(changed) == ["HEARTBEAT", "SYS_STATUS", "SERVO_OUTPUT_RAW"]


def test_counters_are_sent_with_the_heartbeat() -> None:
    device, host = device_end(), host_end()
    reported = report(frames=65_535, errors=65_534, watchdog_trips=65_533)
    data = device.encode(reported) + device.tick(0) + device.encode(reported)
    first, second = reports(host.feed(data))
    assert first.watchdog_trips == second.watchdog_trips == 65_533
    assert (second.frames, second.errors) == (65_535, 65_534)


@pytest.mark.parametrize("open_end", [host_end, device_end])
def test_heartbeats_are_sent_once_a_second_and_missed_ones_are_skipped(open_end: Any) -> None:
    end, decoder, beats = open_end(), Peer(), []
    now = 0
    while now < 5_000 * MS:
        now = max(now, end.deadline_ns)
        beats += [now] * decoder.names(end.tick(now)).count("HEARTBEAT")
        now += 1
    assert [later - earlier for earlier, later in pairwise(beats)] == [1_000 * MS] * 5
    assert decoder.names(end.tick(10**12)).count("HEARTBEAT") == 1
    assert end.deadline_ns > 10**12, "and then has its peace"


def test_the_age_of_a_command_counts_on_the_device_clock() -> None:
    board, host = Board(), host_end()
    board.clock.now = 3 * 10**9
    host.feed(board.take(host.encode(order(7))))
    ages = []
    for _ in range(3):
        board.clock.now += 20 * MS
        ages += [t.age_us for t in reports(host.feed(board.end.encode(board.stm32.telemetry(board.clock.now))))]
    assert ages == [20_000, 40_000, 60_000]
    (received,) = reports(host.feed(board.take(host.encode(order(8, (1600,) * 4)))))
    assert (received.sequence, received.age_us) == (8, 0)


def test_reordered_commands_are_refused() -> None:
    board, host = Board(), host_end()
    host.feed(board.take(host.encode(order(0))))
    packets = [host.encode(order(i, (1500 + i,) * 4)) for i in range(1, 5)]
    for i in (0, 2, 1, 3):
        board.take(packets[i])
    assert board.stm32.refused == 1
    assert board.pwm_us == [1504] * 4


def test_reordered_reports_are_ignored() -> None:
    """Old pulses and counters are ignored, as on UDP; those of a device that has restarted are not."""
    clock = Clock(10_000 * MS)
    device, host = device_end(clock=clock), host_end()
    reported = []
    for number in range(1, 40):
        clock.now += 20 * MS
        telling = report((1500 + number,) * 4, frames=number, watchdog_trips=number)
        reported.append(device.encode(telling))  # trips change: the counters go with each
    results = []
    for number in (30, 32, 31, 33):
        results += [(received.pwm_us[0], received.frames) for received in reports(host.feed(reported[number - 1]))]
    assert results == [(1530, 30), (1532, 32), (1533, 33)]
    again = device_end(clock=Clock())
    (received,) = reports(host.feed(again.encode(report((1501,) * 4, frames=1, watchdog_trips=1))))[-1:]
    assert (received.pwm_us[0], received.frames) == (1501, 1)


def test_packet_numbers_may_wrap_and_jump() -> None:
    board, host, decoder = Board(), host_end(), Peer()
    for i in range(600):
        board.take(host.encode(order(i, (1100 + i,) * 4)))
        host.feed(board.end.tick(0))
        if i % 7 == 0:
            host.tick(i)  # lost
    assert board.stm32.refused == 0
    assert board.pwm_us == [1699] * 4
    assert decoder.names(host.encode(order(600)))[-1] == "SERVO_OUTPUT_RAW"


def test_other_mavlink_systems_on_the_wire_are_ignored() -> None:
    board, host = Board(), host_end()
    host.feed(board.take(host.encode(order(1))))
    ground, other_vehicle = Peer(255, 190), Peer(2, 1)
    foreign = [
        ground.pack(dialect.MAVLink_heartbeat_message(6, 8, 192, 0, 4, 3)),
        other_vehicle.pack(dialect.MAVLink_heartbeat_message(2, 3, 0, 0, 5, 3)),
        other_vehicle.pack(dialect.MAVLink_sys_status_message(0, 0, 0, 0, 0, 0, 0, 0, 9, 9, 9, 9, 9)),
        other_vehicle.servos([1999] * 16),
        other_vehicle.pack(dialect.MAVLink_attitude_message(0, 0.1, 0.2, 0.3, 0.0, 0.0, 0.0)),
        ground.long(dialect.MAV_CMD_COMPONENT_ARM_DISARM, 0.0, system=2),
        ground.long(dialect.MAV_CMD_COMPONENT_ARM_DISARM, 0.0, component=154),
        ground.pack(dialect.MAVLink_rc_channels_override_message(2, 1, *[1111] * 8)),
        ground.pack(dialect.MAVLink_manual_control_message(2, 1000, 0, 500, 0, 0)),
        Peer(1, 191).servos([1234] * 4, port=1),  # another set of outputs
        Peer(1, 1).servos([1234] * 4, port=1),
    ]
    for packet in foreign:
        assert board.end.feed(packet) == host.feed(packet) == []
    assert board.end.replies() == host.replies() == b""
    assert board.end.feed(Peer(1, 1).servos([1234] * 4)) == [], "our own echo is no command"
    (received,) = reports(host.feed(board.take(host.encode(order(2, (1600,) * 4)))))
    assert (received.armed, received.timed_out, received.errors, received.pwm_us) == (True, False, 0, (1600,) * 4)
    for end in (board.end, host):
        assert (end.counters.malformed, end.counters.dropped_bytes, end.counters.checksum_errors) == (0, 0, 0)


def test_both_ends_answer_timesync() -> None:
    clock, peer = Clock(123_456_789_012), Peer()
    for end in (host_end(clock=clock), device_end(clock=clock)):
        assert end.feed(peer.pack(dialect.MAVLink_timesync_message(0, 42))) == []
        (answer,) = peer.parse(end.replies())
        assert (answer.tc1, answer.ts1) == (clock.now, 42)
        assert end.feed(peer.pack(answer)) == []
        assert end.replies() == b"", "an answer needs no answer"


def test_an_end_refuses_to_send_a_wrong_kind_or_number() -> None:
    with pytest.raises(ValueError, match="4 channels, not 3"):
        host_end().encode(order(1, (1500,) * 3))
    with pytest.raises(ValueError, match="4 channels, not 5"):
        device_end().encode(report((1500,) * 5))
    with pytest.raises(ValueError, match="sends commands"):
        host_end().encode(report())
    with pytest.raises(ValueError, match="sends reports"):
        device_end().encode(order(1))


def test_ids_can_be_chosen() -> None:
    ids = {"system": 7, "component": 140, "host_component": 25}
    board, host, decoder = Board(**ids), host_end(**ids), Peer()
    packets = host.encode(order(1))
    assert {(m.get_srcSystem(), m.get_srcComponent()) for m in decoder.parse(packets)} == {(7, 25)}
    output = board.take(packets)
    assert {(m.get_srcSystem(), m.get_srcComponent()) for m in decoder.parse(output)} == {(7, 140)}
    assert reports(host.feed(output))[-1].pwm_us == PULSES
    assert Board().take(packets) == b"", "another system's"


LOADED = """
import logging  # the dialect loads it, and it loads dataclasses from Python 3.14 on
import sys
before = set(sys.modules)
import hil.links.mavlink.link
assert not [name for name in sys.modules if name.startswith("pymavlink")]
hil.links.mavlink.link.open_mavlink("device", 6)
print(*sorted({"numpy", "pymavlink.mavutil", "dataclasses", "asyncio", "lxml"} & (set(sys.modules) - before)))
"""


def test_only_the_dialect_is_loaded_and_only_when_used() -> None:
    done = subprocess.run([sys.executable, "-c", LOADED], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == []
