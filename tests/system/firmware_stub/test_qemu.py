"""The shipped images in QEMU: QEMU reads the timers, so that the pulses are not those the firmware reports."""

import os
import shutil
import time
from collections.abc import Iterator

import psutil
import pytest

from firmware_stub.image import CHIPS
from hil.links.contract import Protocol, ThrusterCommand, ThrusterLink
from hil.links.protocols import open_protocol
from tests.support.firmware.qemu import PROGRAM, QemuStm32
from tests.support.links.link_contract import nothing_leaks, uuv_hil, wait_telemetry

PATIENCE_S = 60.0
NEUTRAL = (1500,) * 8
FULL = (1900, 1100, 1600, 1400, 1500, 1501, 800, 2200)


@pytest.fixture
def cpu() -> Iterator[int]:
    """Pin this process, and with it both ends, to one processor."""
    before = os.sched_getaffinity(0)
    cpu = max(before)
    os.sched_setaffinity(0, {cpu})
    yield cpu
    os.sched_setaffinity(0, before)


@pytest.fixture(params=CHIPS)
def stm32(request: pytest.FixtureRequest, cpu: int) -> Iterator[QemuStm32]:
    with nothing_leaks():
        stm32 = QemuStm32(8, 0.2, cpu, request.param)
        yield stm32
        stm32.close()
    assert not psutil.pid_exists(stm32.pid)


def assert_pulses(stm32: QemuStm32, pulses: tuple[int, ...]) -> None:
    """Assert the pulses in the timers, where the emulated machine has some."""
    assert stm32.pwm_us() == (pulses if stm32.machine.has_timers else (0,) * 8)


def link_to(stm32: QemuStm32, protocol: Protocol | None = None) -> ThrusterLink:
    return ThrusterLink(stm32.wire, protocol or uuv_hil())


@pytest.mark.qemu
@pytest.mark.skipif(not shutil.which(PROGRAM), reason=f"needs {PROGRAM}")
class TestQemu:
    def test_commanded_pulses_are_in_the_timers(self, stm32: QemuStm32) -> None:
        link = link_to(stm32)
        assert_pulses(stm32, NEUTRAL)
        link.send(ThrusterCommand(7, True, FULL))
        answer = wait_telemetry(link, lambda report: report.sequence == 7)
        assert (answer.pwm_us, answer.armed, answer.frames, answer.errors) == (FULL, True, 1, 0)
        assert_pulses(stm32, FULL)
        link.send(ThrusterCommand(8, True, (700, *FULL[1:])))
        wait_telemetry(link, lambda report: report.sequence == 8)
        assert_pulses(stm32, (0, *FULL[1:]))

    def test_the_watchdog_sets_the_timers_to_neutral(self, stm32: QemuStm32) -> None:
        link = link_to(stm32)
        link.send(ThrusterCommand(7, True, FULL))
        silent = wait_telemetry(link, lambda report: report.timed_out)
        assert 200_000 <= silent.age_us < 210_000, "of its own time"
        assert (silent.armed, silent.pwm_us, silent.watchdog_trips) == (False, NEUTRAL, 1)
        assert_pulses(stm32, NEUTRAL)
        link.send(ThrusterCommand(1, True, FULL))
        assert not wait_telemetry(link, lambda report: report.sequence == 1).timed_out
        assert_pulses(stm32, FULL)

    def test_a_damaged_frame_moves_nothing_and_is_counted(self, stm32: QemuStm32) -> None:
        link = link_to(stm32)
        frame = bytearray(uuv_hil().encode(ThrusterCommand(7, True, FULL)))
        frame[10] ^= 1
        link.wire.write(bytes(range(256)) + frame)
        assert wait_telemetry(link, lambda report: report.errors > 0).frames == 0
        assert_pulses(stm32, NEUTRAL)

    def test_every_command_is_answered(self, stm32: QemuStm32) -> None:
        link = link_to(stm32)
        for sequence in range(1, 101):
            pulses = tuple(1400 + (sequence * 7 + i) % 200 for i in range(8))
            link.send(ThrusterCommand(sequence, True, pulses))
            answer = wait_telemetry(link, lambda report, wanted=sequence: report.sequence == wanted)  # type: ignore[misc]
            assert (answer.pwm_us, answer.frames) == (pulses, sequence)
        assert link.counters.checksum_errors == link.counters.dropped_bytes == 0

    def test_the_firmware_in_qemu_is_commanded_by_mavlink(self, stm32: QemuStm32) -> None:
        pytest.importorskip("pymavlink")
        link = link_to(stm32, open_protocol("mavlink", "host", 8))
        for sequence in range(1, 10):
            link.send(ThrusterCommand(sequence, True, FULL))
            if wait_telemetry(link, lambda report: True).armed:
                break
        link.send(ThrusterCommand(20, True, (1555, *FULL[1:])))
        assert wait_telemetry(link, lambda report: report.sequence == 20).armed
        assert_pulses(stm32, (1555, *FULL[1:]))

    def test_every_byte_value_is_transmitted_unchanged(self, stm32: QemuStm32) -> None:
        """QEMU's multiplexer uses the byte 0x01 for its own commands."""
        link = link_to(stm32)
        link.send(ThrusterCommand(0x0101, True, (0x0401, 0x0501, 0x0601, 0x0701, 0x0101, 0x0401, 0x0501, 0x0601)))
        answer = wait_telemetry(link, lambda report: report.frames > 0)
        assert (answer.sequence, answer.errors) == (0x0101, 0)
        assert answer.pwm_us[:4] == (0x0401, 0x0501, 0x0601, 0x0701)

    def test_the_emulated_clock_runs_at_about_real_time(self, stm32: QemuStm32) -> None:
        """The clock is compared from one report to the next; QEMU loses ticks and never adds any.

        Its core has the frequency of the QEMU machine, not that of the chip.
        """
        link = link_to(stm32)
        link.send(ThrusterCommand(1, True, FULL))
        first = wait_telemetry(link, lambda report: report.sequence == 1)
        before, began = wait_telemetry(link, lambda report: report.age_us > first.age_us), time.monotonic()
        later = wait_telemetry(link, lambda report: report.age_us > before.age_us + 500_000)
        ratio = (later.age_us - before.age_us) / 1e6 / (time.monotonic() - began) / stm32.machine.speed
        assert 0.05 < ratio < 1.5
