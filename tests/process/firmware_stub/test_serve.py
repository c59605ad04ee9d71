"""The STM32 as a process, commanded by a program that uses only the serial port and the frame format."""

import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import serial

from firmware_stub.serve import serve
from firmware_stub.stub import Stm32, Stm32End
from hil.common.errors import DeviceError
from hil.links.contract import ThrusterCommand, ThrusterLink, ThrusterTelemetry
from hil.links.wires.terminal import PtyHostWire, PtyWire, UartWire
from tests.support.links.link_contract import nothing_leaks, read_messages, uuv_hil

ROOT = Path(__file__).parents[3]
PATIENCE_S = 60.0
FULL = (1900, 1100, 1600, 1400, 1500, 1501)


def start(*options: object) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "firmware_stub.serve", *map(str, options)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=ROOT,
    )


def finish(process: subprocess.Popen[str]) -> tuple[int, str, str]:
    """Return exit code, standard output and standard error of a process that is about to end."""
    out, err = process.communicate(timeout=PATIENCE_S)
    return process.returncode, out, err


@pytest.fixture
def device(tmp_path: Path) -> Path:
    return tmp_path / "stm32"


@pytest.fixture
def stm32(device: Path) -> Iterator[subprocess.Popen[str]]:
    process = start("--port", f"pty:{device}", "--watchdog", "150 ms")
    assert process.stdout is not None
    assert str(device) in process.stdout.readline()
    yield process
    process.kill()
    process.communicate()


class ForeignProgram:
    """Vehicle software of another author: pyserial and the frame format, without the link of this project."""

    def __init__(self, device: Path) -> None:
        self.port = serial.Serial(str(device), 115_200, timeout=0.05, exclusive=True)
        self.frames = uuv_hil()

    def order(self, sequence: int, armed: bool, pwm_us: tuple[int, ...]) -> None:
        self.port.write(self.frames.encode(ThrusterCommand(sequence, armed, pwm_us)))

    def wait(self, condition: Callable[[ThrusterTelemetry], bool]) -> ThrusterTelemetry:
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            for message in self.frames.feed(self.port.read(max(1, self.port.in_waiting))):
                if isinstance(message, ThrusterTelemetry) and condition(message):
                    return message
        pytest.fail("no such telemetry")


def test_a_foreign_program_commands_the_stm32(stm32: subprocess.Popen[str], device: Path) -> None:
    program = ForeignProgram(device)
    with program.port:
        first = program.wait(lambda report: True)
        assert (first.armed, first.frames, first.pwm_us) == (False, 0, (1500,) * 6)
        program.order(41, True, FULL)
        answer = program.wait(lambda report: report.sequence == 41)
        assert (answer.armed, answer.timed_out, answer.pwm_us, answer.frames) == (True, False, FULL, 1)
        assert answer.age_us == 0
        silent = program.wait(lambda report: report.timed_out)
        assert (silent.armed, silent.pwm_us, silent.watchdog_trips, silent.errors) == (False, (1500,) * 6, 1, 0)
        assert 150_000 <= silent.age_us < 60_000_000
        program.order(42, True, FULL)
        assert program.wait(lambda report: report.sequence == 42).pwm_us == FULL
        counters = program.frames.counters
        assert (counters.checksum_errors, counters.malformed) == (0, 0)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_it_cleanly(stm32: subprocess.Popen[str], device: Path, number: signal.Signals) -> None:
    program = ForeignProgram(device)
    with program.port:
        program.order(1, True, FULL)
        program.wait(lambda report: report.armed)
        stm32.send_signal(number)
        code, out, err = finish(stm32)
    assert (code, err) == (0, "")
    (line,) = out.splitlines()
    assert line.startswith("stopped: 1 commands, 0 refused, 0 checksum errors")
    assert line.endswith("disarmed, pwm 1500 1500 1500 1500 1500 1500")
    assert os.listdir(device.parent) == []


@pytest.mark.parametrize(
    ("options", "code", "messages"),
    [
        (["--watchdog", "200"], 2, ["--watchdog", "with its unit", "'200'"]),
        (["--watchdog", "0 ms"], 2, ["watchdog", "from 0.01 to 60 s", "'0 ms'"]),
        (["--channels", "17"], 2, ["channels", "from 1 to 16", "'17'"]),
        (["--frame", "uuv_hill"], 2, ["'uuv_hill'", "did you mean 'uuv_hil'"]),
        (["--frame", "/nowhere/lab.toml"], 2, ["/nowhere/lab.toml", "no such file"]),
        (["--protocol", "vesc"], 2, ["protocol 'vesc' needs a CAN bus", "the port is 'pty:/"]),
        (["--port", "can:virtual:a"], 2, ["protocol 'frame' needs a wire of bytes", "can:virtual:a"]),
        (["--port", "com3"], 2, ["'com3' is not the address of a wire"]),
        (["--protocol", "mavlink", "--option", "sistem=1"], 2, ["mavlink", "'sistem'", "did you mean 'system'"]),
        (["--protocol", "mavlink", "--option", "system"], 2, ["option", "'system' is not NAME=VALUE"]),
        (["--port", "/dev/ttyNOWHERE"], 3, ["/dev/ttyNOWHERE", "no such device", "serial ports here"]),
    ],
)
def test_a_wrong_option_is_one_line(options: list[str], code: int, messages: list[str]) -> None:
    found, out, err = finish(start(*options))
    assert (found, out) == (code, "")
    (line,) = err.splitlines()
    assert line.startswith("uuv-hil stm32: ")
    assert all(word in line for word in messages), line


def test_a_frame_with_too_few_channels_is_refused(tmp_path: Path) -> None:
    ours = (ROOT / "firmware_stub" / "frames" / "uuv_hil.toml").read_text()
    frame = tmp_path / "four.toml"
    frame.write_text(ours.replace('name = "pwm_us", type = "u16"', 'name = "pwm_us", type = "u16", channels = 4'))
    code, _, err = finish(start("--frame", frame))
    assert code == 2
    assert re.search(rf"frame {re.escape(str(frame))} carries 4 thrusters, not 6", err)


def test_serve_ends_on_request_and_reports(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("firmware_stub.serve.REPORT_PERIOD_NS", 30_000_000)
    with nothing_leaks():
        wire = PtyWire()
        host = ThrusterLink(PtyHostWire(wire.path), uuv_hil())
        end = Stm32End(Stm32(6), ThrusterLink(wire, uuv_hil()))
        reports: list[int] = []
        stop = os.eventfd(0)
        thread = threading.Thread(target=serve, args=(end, stop, lambda end: reports.append(end.stm32.frames)))
        thread.start()
        assert len(read_messages(host, 3)) == 3, "reports without a request"
        os.eventfd_write(stop, 1)
        thread.join(PATIENCE_S)
        assert not thread.is_alive()
        assert reports
        host.close()
        os.close(stop)


def test_quiet_mode_does_not_wake_up_for_reports(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("firmware_stub.serve.REPORT_PERIOD_NS", 1)
    read_fd, write_fd = os.pipe()
    end = Stm32End(Stm32(6), ThrusterLink(PtyWire(), uuv_hil()))
    serving = threading.Thread(target=serve, args=(end, read_fd))
    before = time.process_time()
    serving.start()
    time.sleep(0.5)
    duration = time.process_time() - before
    os.write(write_fd, b"x")
    serving.join()
    os.close(read_fd)
    os.close(write_fd)
    assert duration < 0.3, "and not all of the 0.5 s"


def test_serve_ends_when_its_uart_is_removed() -> None:
    with nothing_leaks():
        far_wire = PtyWire()
        end = Stm32End(Stm32(6), ThrusterLink(UartWire(far_wire.path), uuv_hil()))
        read_fd, write_fd = os.pipe()
        far_wire.close()
        with pytest.raises(DeviceError, match="went away"):
            serve(end, read_fd)
        assert end.fileno() == -1
        os.close(read_fd)
        os.close(write_fd)
