"""Thrusters on VESC controllers: bytes by hand from the protocol's document, and both of our ends."""

import json
from pathlib import Path
from struct import pack, unpack
from typing import Any, cast

import pytest

from firmware_stub.stub import Stm32, Stm32End
from hil.links.can_thrusters import MotorValues
from hil.links.contract import PWM_NEUTRAL_US, ThrusterCommand, ThrusterLink, ThrusterTelemetry
from hil.links.vesc.device import VescDevice
from hil.links.vesc.host import VescHost
from hil.links.vesc.link import open_vesc
from hil.links.wires.can_frame import CanFrame
from tests.support.links.can_bench import MemoryBus, VirtualCanContract, exchange, frames, records
from tests.support.links.can_pairs import socket_pair
from tests.support.links.link_contract import CanLinkContract

# Computed by hand after documentation/comm_can.md of github.com/vedderb/bldc.
GOLDEN: dict[str, Any] = json.loads((Path(__file__).parents[2] / "vectors" / "vesc.json").read_text())
PULSES = (1100, 1499, 1500, 1501, 1777, 1900)
NEUTRAL = (PWM_NEUTRAL_US,) * 6
MS = 1_000_000


def host(channels: int = 6, **settings: Any) -> VescHost:
    return cast("VescHost", open_vesc("host", channels, **settings))


def device(channels: int = 6, **settings: Any) -> VescDevice:
    return cast("VescDevice", open_vesc("device", channels, **settings))


def report(pulses: tuple[int, ...] = PULSES, **changes: Any) -> ThrusterTelemetry:
    return ThrusterTelemetry(0, True, False, pulses, 0, 0, 0, 0)._replace(**changes)


def hex_frames(output: bytes) -> list[list[str]]:
    return [[f"{frame.id:08x}", frame.data.hex()] for frame in frames(output)]


def golden_records(vector: dict[str, Any]) -> bytes:
    return records(CanFrame(int(can_id, 16), bytes.fromhex(data)) for can_id, data in vector["frames"])


def frame_record(command: int, controller: int, argument: int | bytes) -> bytes:
    data = argument if isinstance(argument, bytes) else pack(">i", argument)
    return records([CanFrame(command << 8 | controller, data)])


@pytest.mark.parametrize("vector", GOLDEN["commands"], ids=lambda vector: vector["name"])
def test_commands_have_the_golden_bytes(vector: dict[str, Any]) -> None:
    command = ThrusterCommand(5, vector["armed"], tuple(vector["pwm_us"]))
    assert hex_frames(host(3, command=vector["command"]).encode(command)) == vector["frames"]
    shown = tuple(pulse if pulse in range(800, 2201) else 0 for pulse in command.pwm_us)
    expected = command._replace(sequence=0, pwm_us=shown if command.armed else (1500,) * 3)
    assert device(3).feed(golden_records(vector)) == [expected]


@pytest.mark.parametrize("vector", GOLDEN["reports"], ids=lambda vector: vector["name"])
def test_reports_have_the_golden_bytes(vector: dict[str, Any]) -> None:
    pulses = tuple(vector["pwm_us"])
    assert hex_frames(device(3).encode(report(pulses))) == vector["frames"]
    (received,) = host(3).feed(golden_records(vector))
    assert isinstance(received, ThrusterTelemetry)
    assert received.pwm_us == pulses


def test_the_example_of_the_protocol_document_is_refused() -> None:
    """The example, 51 A to VESC 23, is 0x0117 with 00 00 C7 38; no thruster is set by amperes: it is refused."""
    receiver = device(1, first_id=23)
    assert receiver.feed(records([CanFrame(0x0117, bytes.fromhex("0000c738"))])) == []
    assert receiver.counters.malformed == 1


@pytest.mark.parametrize("command", ["duty", "rpm", "current_rel"])
@pytest.mark.parametrize("full_erpm", [800.0, 24_500.0, 1e6])
def test_every_pulse_width_survives_a_round_trip(command: str, full_erpm: float) -> None:
    settings = {"command": command, "full_erpm": full_erpm}
    master, end = host(3, **settings), device(3, **settings)
    for sequence, pulse in enumerate(range(1100, 1901)):
        pulses = (pulse, 3000 - pulse, 1500)
        (order,) = exchange(master, ThrusterCommand(sequence, True, pulses), end)
        assert order == ThrusterCommand(0, True, pulses)
        (answer,) = exchange(end, report(pulses), master)
        if pulse != 1500:  # three commands of equal pulses are one
            assert answer == report(pulses, sequence=sequence, frames=cast("ThrusterTelemetry", answer).frames)
    assert (master.counters.malformed, end.counters.malformed) == (0, 0)


def test_a_command_is_complete_with_one_frame_a_controller() -> None:
    end = device(3)
    assert end.feed(frame_record(0, 1, 100_000)) == []
    assert end.feed(frame_record(0, 3, -100_000)) == []
    assert end.feed(frame_record(0, 2, 50_000)) == [ThrusterCommand(0, True, (1900, 1700, 1100))]
    assert end.feed(frame_record(0, 2, 0)) == []
    assert end.feed(frame_record(0, 2, 25_000)) == [ThrusterCommand(0, True, (1900, 1500, 1100))], (
        "the other controllers continue"
    )
    assert end.feed(frame_record(0, 2, 75_000)) == [ThrusterCommand(0, True, (1900, 1600, 1100))]


@pytest.mark.parametrize("status_period", [0.01, 0.1, 1.0, 10.0])
def test_a_controller_without_commands_releases_its_motor(status_period: float) -> None:
    now_ns = 0
    end = device(3, status_period=status_period, clock=lambda: now_ns)
    end.feed(frame_record(0, 1, 100_000) + frame_record(0, 2, 100_000) + frame_record(0, 3, 100_000))
    for now_ns in range(0, 700 * MS, 20 * MS):
        if now_ns >= end.deadline_ns:
            end.tick(now_ns)
        received = end.feed(frame_record(0, 2, 50_000))
        held = 1900 if now_ns <= 500 * MS else 0
        if now_ns:
            assert received == [ThrusterCommand(0, True, (held, 1700, held))]


def test_the_broadcast_address_commands_all_controllers() -> None:
    assert device(3).feed(frame_record(0, 255, 50_000)) == [ThrusterCommand(0, True, (1700,) * 3)]
    assert device(3).feed(frame_record(1, 255, 0)) == [ThrusterCommand(0, False, (1500,) * 3)]
    assert device(1).feed(frame_record(0, 255, 10**9)) == [ThrusterCommand(0, True, (1900,))], (
        "more than full is limited to full"
    )


def test_frames_of_others_are_ignored() -> None:
    end, master = device(3), host(3)
    assert end.feed(frame_record(0, 4, 5) + frame_record(0, 0, 5) + frame_record(9, 77, bytes(8))) == []
    assert (
        master.feed(
            frame_record(9, 4, bytes(8))
            + frame_record(0, 1, 0)
            + frame_record(14, 1, bytes(8))
            + frame_record(15, 2, bytes(8))
        )
        == []
    )
    short = records([CanFrame(1, pack(">i", 5), extended=False)])
    assert end.feed(short) == []
    assert (end.counters.malformed, master.counters.malformed) == (0, 0)


def test_unsupported_and_malformed_commands_are_counted() -> None:
    end, master = device(3), host(3)
    for number in (2, 4, 11, 12, 13, 99):
        assert end.feed(frame_record(number, 1, 5)) == []
    assert end.feed(frame_record(0, 1, b"abc") + frame_record(17, 1, b"")) == []
    assert end.counters.malformed == 8
    assert master.feed(frame_record(9, 1, bytes(7)) + frame_record(27, 1, bytes(5))) == []
    assert master.counters.malformed == 2


def test_a_ping_is_answered() -> None:
    end = device(2, first_id=10)
    assert end.feed(frame_record(17, 11, b"\xfe")) == []
    assert hex_frames(end.replies()) == [["000012fe", "0b00"]]
    assert end.replies() == b""
    end.feed(frame_record(17, 255, b"\xfe"))
    assert [data for _, data in hex_frames(end.replies())] == ["0a00", "0b00"]


def test_slow_status_frames_carry_voltage_temperature_and_tachometer() -> None:
    def values(thruster: int, _pulse_us: int) -> MotorValues:
        return MotorValues(14.8, 2.5 + thruster, 273.15 + 31.5)

    end, master = device(2, motor_values=values, status_period=0.2, full_erpm=6000), host(2, full_erpm=6000)
    exchange(end, report((1900, 1300)), master)
    for now_ns in range(0, 1001 * MS, 50 * MS):
        output = end.tick(now_ns) if now_ns >= end.deadline_ns else b""
        assert bool(output) == (now_ns % (200 * MS) == 0)
        assert master.feed(output) == []
    slow = [frame for frame in hex_frames(output) if frame[0].startswith("000010")]  # 31.5 C and 2.5 A, 3.5 A, times 10
    assert slow == [["00001001", "013b013b00190000"], ["00001002", "013b013b00230000"]]
    first, second = master.motors
    assert first.voltage_v == 14.8
    assert (first.erpm, first.duty, second.erpm, second.duty) == (6000, 1.0, -3000, -0.5)
    assert first.current_a == 2.5
    assert (first.tachometer, second.tachometer) == (600, -300), "6 a turn, 100 and -50 turns in a second"


def test_status_5_has_the_firmwares_layout() -> None:
    end = device(1)
    *_, (can_id, data) = hex_frames(end.tick(0))
    assert (can_id, data) == ("00001b01", "00000000" + "00a0" + "0000")
    master = host(1)
    master.feed(frame_record(27, 1, bytes.fromhex("fffffff4" + "00a0")))
    assert (master.motors[0].tachometer, master.motors[0].voltage_v) == (-12, 16.0)


def test_controllers_commanded_by_rpm_are_read_by_rpm() -> None:
    master = host(1, command="rpm")
    (received,) = master.feed(frame_record(9, 1, pack(">ihh", 12_250, 30, 617)))
    assert cast("ThrusterTelemetry", received).pwm_us == (1700,)
    (received,) = host(1).feed(frame_record(9, 1, pack(">ihh", 12_250, 30, 617)))
    assert cast("ThrusterTelemetry", received).pwm_us == (1747,)


def test_the_stm32_drives_stops_and_recovers_on_the_bus() -> None:
    bus = MemoryBus()
    master = ThrusterLink(bus.wire(), host())
    end = Stm32End(Stm32(6), ThrusterLink(bus.wire(), device()))
    received: list[ThrusterTelemetry] = []
    now_ns = 0

    def run(seconds: float) -> None:
        nonlocal now_ns
        for _ in range(round(seconds * 200)):
            now_ns += 5 * MS
            end.service(now_ns)
            received.extend(cast("list[ThrusterTelemetry]", master.receive()))

    run(0.1)
    assert not any(t.armed or t.timed_out or t.frames for t in received)
    assert {t.pwm_us for t in received} == {NEUTRAL}
    for sequence in range(1, 21):
        master.send(ThrusterCommand(sequence, True, (1500 + sequence,) * 6))
        run(0.02)
        assert received[-1] == ThrusterTelemetry(sequence, True, False, (1500 + sequence,) * 6, 0, sequence, 0, 0)
    run(1.0)
    assert received[-1] == ThrusterTelemetry(20, False, True, NEUTRAL, 0, 20, 0, 1)
    assert end.stm32.watchdog_trips == 1
    master.send(ThrusterCommand(21, True, PULSES))
    run(0.02)
    assert received[-1] == ThrusterTelemetry(21, True, False, PULSES, 0, 21, 0, 1)
    master.send(ThrusterCommand(22, False, PULSES))
    run(0.02)
    assert received[-1] == ThrusterTelemetry(22, False, False, NEUTRAL, 0, 22, 0, 1)
    assert not end.stm32.armed
    run(0.5)
    assert received[-1] == ThrusterTelemetry(22, False, False, NEUTRAL, 0, 22, 0, 1)
    for link in (master, end.link):
        assert (link.counters.malformed, link.counters.dropped_bytes) == (0, 0)


def test_the_tachometer_wraps_around() -> None:
    end = device(1, full_erpm=1e6)
    end.encode(report((1900,)))
    end.tick(0)
    end._tachometers[0] = 2.0**31 - 1
    output = frames(end.tick(end.deadline_ns))
    (tachometer,) = unpack(">i", output[-1].data[:4])
    assert tachometer == -(2**31) + 10_000 - 1


class Vesc(CanLinkContract):
    """The parts of commands and reports that VESC's protocol carries."""

    protocol = "vesc"
    commands_carry = ("armed", "pwm_us")
    reports_carry = ("sequence", "armed", "timed_out", "pwm_us", "frames")


class TestVescOnSocketCan(Vesc):
    open_wires = staticmethod(socket_pair)
    host_sees_hangup = True


class TestVescOnVirtualCan(VirtualCanContract, Vesc):
    pass
