"""The firmware in C as a process on a pty."""

import fcntl
import os
import shutil
import signal
import sys
import termios
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from firmware_stub import mavlink_headers
from firmware_stub.native import NAME, NativeStm32, build_native, cache_folder
from hil.common.errors import DeviceError
from hil.links.contract import Protocol, ThrusterCommand, ThrusterLink
from hil.links.wires.terminal import PtyHostWire
from tests.support.links.link_contract import nothing_leaks, uuv_hil, wait_telemetry
from tests.support.processes import wait_for

FULL = (1900, 1100, 1600, 1400, 1500, 1501)
NEUTRAL = (1500,) * 6
UNREAD_LIMIT = 2048  # bytes, of `native/main.c`

pytestmark = pytest.mark.skipif(not shutil.which("cc"), reason="needs a C compiler")


@pytest.fixture(scope="module", autouse=True)
def cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Provide a separate cache folder."""
    folder = tmp_path_factory.mktemp("cache")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(folder))
        patch.delenv("CC", raising=False)
        yield folder


@pytest.fixture
def device(tmp_path: Path) -> str:
    return str(tmp_path / "stm32")


@pytest.fixture
def stm32(device: str) -> Iterator[NativeStm32]:
    with nothing_leaks():
        stm32 = NativeStm32(device, 6, 0.15)
        yield stm32
        stm32.close()


def host(device: str, protocol: Protocol | None = None) -> ThrusterLink:
    return ThrusterLink(PtyHostWire(device), protocol or uuv_hil())


def test_the_native_stm32_answers_commands_and_trips_its_watchdog(stm32: NativeStm32, device: str) -> None:
    link = host(device)
    first = wait_telemetry(link, lambda report: True)
    assert (first.armed, first.frames, first.pwm_us) == (False, 0, NEUTRAL)
    link.send(ThrusterCommand(41, True, FULL))
    answer = wait_telemetry(link, lambda report: report.sequence == 41)
    assert (answer.armed, answer.timed_out, answer.pwm_us, answer.frames, answer.age_us) == (True, False, FULL, 1, 0)
    silent = wait_telemetry(link, lambda report: report.timed_out)
    assert (silent.armed, silent.pwm_us, silent.watchdog_trips, silent.errors) == (False, NEUTRAL, 1, 0)
    assert 150_000 <= silent.age_us < 60_000_000
    counters = link.counters
    assert (counters.checksum_errors, counters.malformed, counters.dropped_bytes) == (0, 0, 0)
    link.close()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_it_with_neutral_outputs(stm32: NativeStm32, device: str, number: signal.Signals) -> None:
    link = host(device)
    link.send(ThrusterCommand(1, True, FULL))
    wait_telemetry(link, lambda report: report.armed)
    os.kill(stm32.pid, number)
    assert stm32.close().endswith("1 commands, 0 refused, 0 checksum errors, 0 malformed, 0 bytes dropped, "
                                  "0 watchdog trips; disarmed, pwm 1500 1500 1500 1500 1500 1500")  # fmt: skip
    assert os.listdir(os.path.dirname(device)) == []
    link.close()


def test_more_thrusters_than_it_has_are_refused(device: str) -> None:
    with pytest.raises(DeviceError, match="1 to 16 channels"):
        NativeStm32(device, 17, 0.2)
    assert os.listdir(os.path.dirname(device)) == []


def test_unread_telemetry_does_not_block_it(stm32: NativeStm32, device: str) -> None:
    """Bytes that are not read are lost, as on a UART: a program that opens the port later reads few old reports."""
    fd = os.open(device, os.O_RDWR | os.O_NOCTTY)
    orders = [uuv_hil().encode(ThrusterCommand(sequence, True, FULL)) for sequence in range(400)]

    def unread() -> int:
        return int.from_bytes(fcntl.ioctl(fd, termios.FIONREAD, bytes(4)), sys.byteorder)

    for order in orders:
        before = unread()
        os.write(fd, order)
        if before < UNREAD_LIMIT:  # one answer at a time, however slow the machine is
            assert wait_for(lambda: unread() > before), "an order is answered"  # noqa: B023
        time.sleep(0.0005)
    assert unread() < 1.5 * UNREAD_LIMIT
    link = host(device)
    frames = wait_telemetry(link, lambda report: report.sequence == 399).frames
    assert frames > 390, "a process that gets no processor loses bytes of its line, as a UART does"
    os.close(fd)
    link.close()


def test_a_new_process_starts_after_a_kill(stm32: NativeStm32, device: str) -> None:
    os.kill(stm32.pid, signal.SIGKILL)
    stm32.close()
    second = NativeStm32(device, 2, 0.2)
    link = host(device)
    assert wait_telemetry(link, lambda report: True).pwm_us == (1500, 1500)
    link.close()
    second.close()


def test_a_file_at_its_path_is_not_overwritten(device: str) -> None:
    Path(device).write_text("precious")
    with pytest.raises(DeviceError, match="exists and is not a link to a pty"):
        NativeStm32(device, 6, 0.2)
    assert Path(device).read_text() == "precious"
    assert os.listdir(os.path.dirname(device)) == ["stm32"]


def test_the_program_is_compiled_once(cache: Path) -> None:
    program = build_native()
    before = os.stat(program).st_mtime_ns
    assert build_native() == program
    assert os.stat(program).st_mtime_ns == before
    assert os.path.dirname(program) == cache_folder() == str(cache / "uuv-hil")
    assert [name for name in os.listdir(cache_folder()) if name.startswith(f"{NAME}-") and "." in name] == []


def test_old_programs_are_removed(tmp_path: Path) -> None:
    old_folders = [tmp_path / f"{NAME}-{number:016x}" for number in range(20)]
    for number, path in enumerate(old_folders):
        path.write_bytes(b"x")
        os.utime(path, (number, number))
    (tmp_path / "a.toml.cpython").write_bytes(b"x")
    program = Path(build_native(str(tmp_path)))
    assert [path.exists() for path in old_folders] == [False] * 13 + [True] * 7
    assert program.exists()
    assert (tmp_path / "a.toml.cpython").exists()


def test_without_pymavlink_the_frame_protocol_works(device: str, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pymavlink")
    with_it = build_native()
    monkeypatch.setattr(mavlink_headers, "version", lambda: None)
    assert build_native() != with_it
    stm32 = NativeStm32(device, 6, 0.2)
    link = host(device)
    link.send(ThrusterCommand(3, True, FULL))
    assert wait_telemetry(link, lambda report: report.sequence == 3).pwm_us == FULL
    link.close()
    stm32.close()
