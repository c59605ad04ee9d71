"""The shipped images, each on its emulated STM32: the same behaviour on all chips."""

import hashlib
import random
from collections.abc import Iterator
from typing import NamedTuple

import pytest

from firmware_stub.emulation.rcc import Rcc
from firmware_stub.image import CHIPS, load_image
from firmware_stub.stub import Stm32, Stm32End
from firmware_stub.unicorn_board import UnicornBoard, shipped_image
from hil.common.errors import DeviceError
from hil.links.contract import ThrusterCommand, ThrusterLink, ThrusterTelemetry, Wire
from hil.links.protocols import open_protocol
from hil.links.wires.can_frame import pack_frame, unpack_frames
from tests.support.links.link_contract import uuv_hil

MS = 1_000_000
FULL = (1900, 1100, 1600, 1400, 1501, 1499)
NEUTRAL = [1500] * 6
WITH_CAN = tuple(chip for chip in CHIPS if load_image(chip).can)
FOREVER = b"\xfe\xe7"  # b .


def encode(sequence: int, pwm_us: tuple[int, ...] = FULL, armed: bool = True) -> bytes:
    return uuv_hil().encode(ThrusterCommand(sequence, armed, pwm_us))


def decode(data: bytes) -> list[ThrusterTelemetry]:
    protocol = uuv_hil()
    reports = [message for message in protocol.feed(data) if isinstance(message, ThrusterTelemetry)]
    assert (protocol.counters.checksum_errors, protocol.counters.dropped_bytes) == (0, 0)
    return reports


def power_up(chip: str, channels: int = 6, watchdog_ns: int = 200 * MS, paced: bool = False) -> UnicornBoard:
    return UnicornBoard(shipped_image(chip), channels, watchdog_ns, paced=paced, chip=chip)


@pytest.fixture(params=CHIPS)
def chip(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def board(chip: str) -> UnicornBoard:
    return power_up(chip)


@pytest.mark.parametrize("channels", [1, 5, 8])
def test_the_image_drives_as_many_thrusters_as_configured(chip: str, channels: int) -> None:
    board = power_up(chip, channels)
    board.transmitted()
    pulses = tuple(1200 + 50 * i for i in range(channels))
    board.receive(encode(1, pulses))
    assert tuple(board.pwm_us) == pulses
    assert decode(board.transmitted())[0].pwm_us == pulses


@pytest.mark.parametrize("watchdog_ms", [50, 1000])
def test_a_timeout_stops_the_thrusters_in_the_timer_registers(chip: str, watchdog_ms: int) -> None:
    board = power_up(chip, 6, watchdog_ms * MS)
    board.run_until(7 * MS)
    board.receive(encode(1))
    board.run_until((7 + watchdog_ms) * MS - 1)
    assert board.pwm_us == list(FULL)
    board.run_until((7 + watchdog_ms) * MS)
    assert board.pwm_us == NEUTRAL
    last = decode(board.transmitted())[-1]
    assert (last.timed_out, last.armed, last.watchdog_trips, last.age_us) == (True, False, 1, watchdog_ms * 1000)
    assert board.resets == 0, "the watchdog of the link is not that of the chip"


def test_a_hung_program_is_reset_by_the_watchdog_and_starts_neutral(board: UnicornBoard) -> None:
    board.run_until(30 * MS)
    board.receive(encode(1))
    hangs_at, instruction = board.pc, board.read_memory(board.pc, 2)
    board.write_memory(hangs_at, FOREVER)
    board.run_until(130 * MS)
    assert (board.resets, board.pwm_us) == (0, list(FULL)), "nothing else stops it"
    board.run_until(131 * MS)
    assert (board.resets, board.pwm_us) == (1, NEUTRAL)
    board.run_until(500 * MS)
    assert board.resets == 4, "the program hangs and is reset repeatedly"
    board.write_memory(hangs_at, instruction)
    board.run_until(1000 * MS)
    assert (board.resets, board.pwm_us) == (4, NEUTRAL)
    board.transmitted()
    board.receive(encode(2))
    assert [(r.sequence, r.frames) for r in decode(board.transmitted())] == [(2, 1)], "it counts again"


def test_an_illegal_access_ends_the_program_with_a_message(board: UnicornBoard) -> None:
    board.write_memory(board.pc, bytes.fromhex("4ff0c0400168"))  # mov.w r0,#0x60000000; ldr r1,[r0]
    with pytest.raises(DeviceError, match=r"read 4 bytes at 0x60000000.*pc 0x080.*addr2line"):
        board.run_until(2 * MS)


@pytest.mark.parametrize("access", ["read", "write"])
def test_an_error_in_a_peripheral_is_raised_to_the_caller(
    board: UnicornBoard, access: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Unicorn would lose the exception of its callback; afterwards the board goes on."""

    def breaks(*_: object) -> int:
        raise ZeroDivisionError("in the peripheral")

    with monkeypatch.context() as patch:
        patch.setattr(board._port, access, breaks)
        with pytest.raises(ZeroDivisionError, match="in the peripheral"):
            board.receive(encode(1))
    board.run_until(board.now_ns + 300 * MS)
    board.transmitted()
    board.receive(encode(2))
    assert decode(board.transmitted())


def test_garbage_neither_stops_the_image_nor_moves_a_thruster(board: UnicornBoard) -> None:
    noise = random.Random(3).randbytes(1_000_000)
    board.run_until(10 * MS)
    board.receive(noise)  # a line holds 4096 of them
    assert board.lost == len(noise) - 4096
    for start in range(0, 20_480, 1024):
        board.run_until(board.now_ns + MS)
        board.receive(noise[start : start + 1024])
    assert (board.pwm_us, board.resets) == (NEUTRAL, 0)
    board.run_until(board.now_ns + 20 * MS)
    board.transmitted()
    board.receive(bytes(300) + encode(5))
    board.run_until(board.now_ns + 2 * MS)
    assert board.pwm_us == list(FULL)
    (answer, *_) = decode(board.transmitted())
    assert (answer.sequence, answer.frames) == (5, 1)


# ---- the same as the specification, and the same each time


class Event(NamedTuple):
    """Bytes that arrive at a given time (ms)."""

    at_ms: float
    data: bytes


def host_history(seed: int) -> Iterator[Event]:
    """Yield a random history of a host: commands of all kinds, damage, and pauses that trip the watchdog."""
    rng, at_ms, sequence = random.Random(seed), 3.5, 0
    for _ in range(60):
        at_ms += rng.choice((0, 5, 20, 20, 20, 30, 300)) * rng.uniform(0.9, 1.1)
        sequence += rng.choice((1, 1, 1, 1, 0, -3, 40))
        pulses = tuple(rng.choice((1100, 1500, 1900, 800, 2200, 799, 0, 65535)) for _ in range(6))
        frame = encode(sequence & 0xFFFF, pulses, rng.random() < 0.8)
        kind = rng.random()
        if kind < 0.1:
            frame = frame[:-1] + bytes([frame[-1] ^ 1])
        elif kind < 0.15:
            frame = encode(sequence & 0xFFFF, pulses[:5])
        elif kind < 0.2:
            frame = uuv_hil().encode(ThrusterTelemetry(1, True, False, FULL, 0, 0, 0, 0))
        elif kind < 0.3:
            frame = rng.randbytes(5).replace(b"\xa5", b"") + frame
        yield Event(at_ms, frame)


class MemoryWire(Wire):
    """A wire in memory: bytes in lists."""

    name = "memory"

    def __init__(self) -> None:
        self.incoming, self.outgoing = b"", b""

    def fileno(self) -> int:
        return -1

    def read(self) -> bytes:
        data, self.incoming = self.incoming, b""
        return data

    def write(self, data: bytes) -> int:
        self.outgoing += data
        return len(data)

    def close(self) -> None:
        pass


def run_python(events: list[Event], end_ms: int) -> tuple[list[ThrusterTelemetry], list[list[int]]]:
    """Return reports of the firmware's specification in Python, and its pulses after each event."""
    wire = MemoryWire()
    end = Stm32End(Stm32(6), ThrusterLink(wire, uuv_hil()))
    pulses = []
    for event in [*events, Event(end_ms, b"")]:
        while end.deadline_ns < event.at_ms * MS:
            end.service(end.deadline_ns)
        wire.incoming = event.data
        end.service(round(event.at_ms * MS))
        pulses.append(list(end.stm32.pwm_us))
    return decode(wire.outgoing), pulses


def run_image(chip: str, events: list[Event], end_ms: int, slice_ms: float = 0.0) -> tuple[bytes, list[list[int]], str]:
    """Return the output of the image, its pulses after each event, and a digest of its RAM at the end."""
    board, pulses = power_up(chip), []
    for event in [*events, Event(end_ms, b"")]:
        at_ns = round(event.at_ms * MS)
        while slice_ms and board.now_ns + slice_ms * MS < at_ns:
            board.run_until(board.now_ns + round(slice_ms * MS))
        board.run_until(at_ns)
        board.receive(event.data)
        pulses.append(board.pwm_us)
    return board.transmitted(), pulses, hashlib.sha256(board.read_memory(0x2000_0000, 0x5000)).hexdigest()


@pytest.mark.parametrize(("chip", "seed"), list(zip(CHIPS, range(4), strict=True)))
def test_the_image_behaves_as_its_python_specification(chip: str, seed: int) -> None:
    events = list(host_history(seed))
    end_ms = round(events[-1].at_ms) + 500
    specified, pulses = run_python(events, end_ms)
    output, moved, _ = run_image(chip, events, end_ms)
    reports = decode(output)
    assert moved == pulses
    assert [report._replace(age_us=0) for report in reports] == [report._replace(age_us=0) for report in specified]
    # the image looks at its watchdog and its schedule each millisecond only
    assert all(0 <= a.age_us - b.age_us <= 1000 for a, b in zip(reports, specified, strict=True))
    assert reports[-1].watchdog_trips > 1
    assert reports[-1].errors > 3


@pytest.mark.parametrize("chip", ["f405"])  # this is due to the emulator, not to the image
def test_the_result_does_not_depend_on_how_time_is_sliced(chip: str) -> None:
    events = list(host_history(9))
    end_ms = round(events[-1].at_ms) + 300
    run = run_image(chip, events, end_ms)
    assert len(run[0]) > 1000
    assert run_image(chip, events, end_ms) == run
    assert run_image(chip, events, end_ms, slice_ms=0.37) == run


def test_paced_bytes_delay_the_reply_by_their_transmission_time(chip: str) -> None:
    board = power_up(chip, paced=True)
    board.run_until(25 * MS)
    board.transmitted()
    command = encode(7)
    board.receive(command)
    byte_ns = 10 * MS // 115.2
    board.run_until(25 * MS + int(len(command) * byte_ns * 0.99))
    assert board.pwm_us == NEUTRAL
    board.run_until(25 * MS + int(len(command) * byte_ns * 1.01))
    assert board.pwm_us == list(FULL)
    assert board.transmitted() == b""
    board.run_until(25 * MS + int((len(command) + 33) * byte_ns * 1.01))
    (answer,) = decode(board.transmitted())
    assert (answer.sequence, answer.age_us) == (7, 0)


@pytest.mark.parametrize("chip", WITH_CAN)
def test_the_image_acts_as_vesc_controllers_on_a_can_bus(chip: str) -> None:
    board = power_up(chip)
    host = open_protocol("vesc", "host", 6)
    reports: list[ThrusterTelemetry] = []
    for sequence in range(1, 30):
        board.run_until(sequence * 20 * MS)
        records = host.encode(ThrusterCommand(sequence, True, FULL))
        board.receive_can(unpack_frames(records))
        received = host.feed(b"".join(map(pack_frame, board.transmitted_can())))
        reports += [report for report in received if isinstance(report, ThrusterTelemetry)]
        assert board.pwm_us == list(FULL)
    assert {report.pwm_us for report in reports[1:]} == {FULL}
    assert reports[-1].sequence == 29
    board.run_until((29 * 20 + 200) * MS)
    assert board.pwm_us == NEUTRAL


# ---- the description of a chip agrees with its image


def pin_modes(board: UnicornBoard) -> dict[str, str]:
    """Return what each pin of ports A to C is, of those that the program has set: "driven", "read" with a pull-up."""
    modes = {}
    for port in "ABC":
        registers = board._chip.peripherals[f"GPIO{port}"].registers
        for pin in range(16):
            if board._chip.model.family == "f1":
                mode = registers.get(4 * (pin // 8), 0) >> 4 * (pin % 8) & 15
                name = {10: "driven", 8: "read"}.get(mode, "")
            else:
                alternate = registers.get(0, 0) >> 2 * pin & 3 == 2
                pulled = registers.get(0x0C, 0) >> 2 * pin & 3 == 1
                function = registers.get(0x20 + 4 * (pin // 8), 0) >> 4 * (pin % 8) & 15
                name = f"{'read' if pulled else 'driven'}, function {function}" if alternate else ""
            if name:
                modes[f"P{port}{pin}"] = name
    return modes


def test_the_emulated_chip_agrees_with_its_description(chip: str, board: UnicornBoard) -> None:
    image, model = load_image(chip), board._chip.model
    assert model.device_id in image.device_ids
    assert model.flash_size == image.flash_kib * 1024
    assert ("CAN1" in model.peripherals) == bool(image.can)


def test_the_configured_pins_equal_the_documented_wiring(chip: str, board: UnicornBoard) -> None:
    image = load_image(chip)
    timers, serial, can = ("", "", "") if chip == "f103" else (", function 2", ", function 7", ", function 9")
    wiring = dict.fromkeys(image.outputs, f"driven{timers}")
    wiring |= {image.serial["tx"]: f"driven{serial}", image.serial["rx"]: f"read{serial}"}
    if image.can:
        wiring |= {image.can["tx"]: f"driven{can}", image.can["rx"]: f"read{can}"}
    assert pin_modes(board) == wiring


@pytest.mark.parametrize("crystal", [True, False])
def test_all_clocks_are_right_with_and_without_the_crystal(
    chip: str, crystal: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The chip's times are as the program sets it: a pulse of 1500 us, a bit of serial and of CAN, a millisecond."""
    if not crystal:
        ready, write = 1 << 17, Rcc.write

        def never_ready(rcc: Rcc, offset: int, value: int) -> None:
            write(rcc, offset, value)
            rcc.registers[0] &= ~ready

        monkeypatch.setattr(Rcc, "write", never_ready)
    board = power_up(chip)
    board.run_until(100 * MS)  # for which it waits for a crystal that does not swing
    rcc, hz = board._chip.rcc, {"f103": 64_000_000, "f411": 84_000_000}.get(chip, 168_000_000)
    assert rcc.core_hz == hz
    assert board.pwm_us == NEUTRAL
    assert board._port.byte_ns() == pytest.approx(10e9 / 115_200, rel=0.005)
    if chip in WITH_CAN:
        timing = board._chip.can.registers[0x1C]
        quanta = 3 + (timing >> 16 & 15) + (timing >> 20 & 7)
        assert rcc.apb1_hz / ((timing & 0x3FF) + 1) / quanta == 500_000


def test_half_of_the_smallest_stack_stays_unused() -> None:
    """The F103's 5 KiB hold frames, MAVLink with its answers, noise, the watchdog and CAN."""
    chip = "f103"
    board = power_up(chip)
    bottom = 0x2000_0C80  # behind the variables: 3152 bytes
    top = int.from_bytes(shipped_image(chip)[:4], "little")
    assert top - bottom > 4096
    board.write_memory(bottom, b"\xa5" * ((top - bottom) // 2))
    for event in host_history(5):
        board.run_until(round(event.at_ms * MS))
        board.receive(event.data)
    mavlink, vesc = open_protocol("mavlink", "host", 6), open_protocol("vesc", "host", 6)
    for sequence in range(50):
        command = ThrusterCommand(sequence, True, FULL)
        board.run_until(board.now_ns + 20 * MS)
        board.receive(mavlink.encode(command) + mavlink.tick(board.now_ns) + random.Random(1).randbytes(50))
        board.receive_can(unpack_frames(vesc.encode(command)))
    assert board.transmitted()
    assert board.read_memory(bottom, (top - bottom) // 2).strip(b"\xa5") == b""


def test_no_can_register_is_accessed_on_a_chip_without_can() -> None:
    """The emulated F411 has nothing at that address: the image would have ended with a message."""
    board = power_up("f411")
    assert "CAN1" not in board._chip.peripherals
    board.receive_can(unpack_frames(open_protocol("vesc", "host", 6).encode(ThrusterCommand(1, True, FULL))))
    board.run_until(100 * MS)
    assert (board.transmitted_can(), board.pwm_us) == ([], NEUTRAL)
