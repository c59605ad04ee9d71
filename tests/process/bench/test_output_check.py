"""`uuv-hil stm32 check`: each output turns slowly, one at a time, and the telemetry is shown. The STM32 is emulated."""

import json
import re
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from hil.bench import output_check
from hil.cli import main
from hil.common.children import module_command, package_environment
from hil.links.contract import ThrusterCommand
from hil.slave.drivers.driver import ThrusterDriver

QUICK = ["--yes", "--seconds", "0.2", "--settle", "0.1 s"]
PATIENCE_S = 60.0


@pytest.fixture(autouse=True)
def _short_waiting_times(monkeypatch: pytest.MonkeyPatch) -> None:
    """Shorten the waiting times that are meant for a person, for checks in this process."""
    monkeypatch.setattr(output_check, "ANSWER_S", 1.0)
    monkeypatch.setattr(output_check, "PAUSE_S", 0.15)
    monkeypatch.setattr(output_check, "MORE_S", 0.3)


@pytest.fixture
def emulated_stm32(tmp_path: Path) -> Iterator[tuple[str, "subprocess.Popen[str]"]]:
    """Provide the pty of `uuv-hil stm32`, which runs as a process of its own, and that process."""
    path = str(tmp_path / "stm32")
    command = [*module_command("hil.cli", "stm32", "--port", f"pty:{path}", "--channels", "4")]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=package_environment())
    assert process.stdout
    assert "Ctrl-C" in process.stdout.readline()
    yield path, process
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=PATIENCE_S)


def findings(capsys: pytest.CaptureFixture[str], *arguments: str) -> list[dict[str, Any]]:
    assert main(["stm32", "check", *QUICK, "--json", *arguments]) == 0
    found: list[dict[str, Any]] = json.loads(capsys.readouterr().out)
    return found


def test_outputs_are_checked_over_a_real_pty(
    emulated_stm32: tuple[str, "subprocess.Popen[str]"], capsys: pytest.CaptureFixture[str]
) -> None:
    path, process = emulated_stm32
    assert main(["stm32", "check", *QUICK, "--port", path, "--channels", "4", "--chip", "f411", "--offset", "-80"]) == 0
    output = capsys.readouterr()
    lines = output.out.splitlines()
    for line, pin in zip(lines, ("1 (PA6)", "2 (PA7)", "3 (PB0)", "4 (PB1)"), strict=False):
        assert re.fullmatch(rf"  output {re.escape(pin)}: 1420 us confirmed after \d+\.\d ms", line)
    assert lines[4].startswith("4 of 4 outputs confirmed by telemetry")
    assert output.err.startswith("WARNING: every thruster will turn")
    assert output.err.endswith("all outputs neutral\n")
    process.send_signal(signal.SIGINT)
    assert "pwm 1500 1500 1500 1500" in process.communicate(timeout=PATIENCE_S)[0]


@pytest.mark.parametrize("kind", ["python", "unicorn"])
@pytest.mark.parametrize("protocol", ["frame", "mavlink"])
def test_outputs_of_the_firmware_are_checked_over_serial(
    kind: str, protocol: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(output_check, "MORE_S", 5.0)  # for a machine so busy that the watchdog stops an output
    output_findings = findings(capsys, "--stm32", kind, "--protocol", protocol, "--channels", "3")
    assert [(finding["output"], finding["pulse_us"], finding["reported_us"]) for finding in output_findings] == [
        (i, 1560, 1560) for i in range(1, 4)
    ]
    assert all(finding["passed"] and finding["others"] == [] for finding in output_findings)


@pytest.mark.parametrize(("protocol", "unit"), [("vesc", "ERPM"), ("dronecan", "rpm")])
def test_outputs_are_checked_over_can_with_figures_of_the_motor_controllers(
    protocol: str, unit: str, capsys: pytest.CaptureFixture[str]
) -> None:
    words = f"--stm32 python --protocol {protocol} --port can:virtual:check-{protocol} --channels 3"
    output_findings = findings(capsys, *words.split())
    assert len(output_findings) == 3
    assert all(one["motor"][unit] > 0 and "A" in one["motor"] and "V" in one["motor"] for one in output_findings)


def test_outputs_turn_one_at_a_time_with_neutral_before_and_after(monkeypatch: pytest.MonkeyPatch) -> None:
    """The commands are in this order: neutral, then each output alone, neutral between, disarmed at the end."""
    sent_commands: list[ThrusterCommand] = []
    send = ThrusterDriver.send

    def record(driver: ThrusterDriver, command: ThrusterCommand) -> None:
        sent_commands.append(command)
        send(driver, command)

    monkeypatch.setattr(ThrusterDriver, "send", record)
    assert main(["stm32", "check", *QUICK, "--stm32", "python", "--channels", "3"]) == 0
    phases = [sent_commands[0].pwm_us]
    for command in sent_commands:
        if command.pwm_us != phases[-1]:
            phases.append(command.pwm_us)
    neutral = (1500, 1500, 1500)
    turns = [(1560, 1500, 1500), (1500, 1560, 1500), (1500, 1500, 1560)]
    assert phases == [neutral, turns[0], neutral, turns[1], neutral, turns[2], neutral]
    assert not sent_commands[-1].armed


def test_no_output_turns_when_the_stm32_does_not_answer(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    import os

    near, far = os.openpty()
    try:
        assert main(["stm32", "check", *QUICK, "--port", os.ttyname(far)]) == 3
    finally:
        os.close(near)
        os.close(far)
    assert "the STM32 does not answer: check power, wiring (TX to RX), --baud and --protocol" in capsys.readouterr().err


def test_an_output_that_stays_neutral_is_not_confirmed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The firmware ignores the second output, and moves the third with the first."""
    send = ThrusterDriver.send

    def broken(driver: ThrusterDriver, command: ThrusterCommand) -> None:
        first, _, third = command.pwm_us
        send(driver, command._replace(pwm_us=(first, 1500, first if first != 1500 else third)))

    monkeypatch.setattr(ThrusterDriver, "send", broken)
    assert main(["stm32", "check", *QUICK, "--stm32", "python", "--channels", "3"]) == 1
    first, second, third, last = capsys.readouterr().out.splitlines()
    assert first.endswith("WRONG: telemetry shows that output 3 turned as well")
    assert second == "  output 2: NOT CONFIRMED: telemetry shows neutral instead of 1560 us"
    assert "1560 us confirmed" in third
    assert last.startswith("1 of 3 outputs confirmed")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_ends_the_check_with_neutral_outputs(
    emulated_stm32: tuple[str, "subprocess.Popen[str]"], number: signal.Signals
) -> None:
    path, stm32 = emulated_stm32
    command = module_command("hil.cli", "stm32", "check", "--port", path, "--channels", "4", "--yes", "--settle", "0 s")
    check = subprocess.Popen(
        [*command, "--seconds", "5"],
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=package_environment(),
    )
    assert check.stderr
    assert "WARNING" in check.stderr.readline()
    time.sleep(1.5)
    check.send_signal(number)
    out, err = check.communicate(timeout=PATIENCE_S)
    assert check.returncode == 130, err
    assert "all outputs neutral" in err
    assert "of 4 outputs" not in out
    stm32.send_signal(signal.SIGINT)
    assert "pwm 1500 1500 1500 1500" in stm32.communicate(timeout=PATIENCE_S)[0].splitlines()[-1]


def test_a_lost_link_ends_the_check(emulated_stm32: tuple[str, "subprocess.Popen[str]"]) -> None:
    path, stm32 = emulated_stm32
    command = module_command("hil.cli", "stm32", "check", "--port", path, "--channels", "4", "--yes", "--seconds", "5")
    check = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=package_environment())
    assert check.stderr
    assert "WARNING" in check.stderr.readline()
    time.sleep(1.0)
    stm32.kill()
    _, err = check.communicate(timeout=PATIENCE_S)
    assert check.returncode == 3, err
    assert "link" in err.splitlines()[-1]
    assert "neutral not confirmed: the STM32's watchdog stops the outputs" in err
