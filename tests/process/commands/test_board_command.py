"""`uuv-hil board`: what it shows, and that install and uninstall together leave a machine unchanged."""

import json
import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from hil import cli
from hil.common.clock import LOOP_PRIORITY
from hil.install.units import CAN_UNIT, LIMITS, RULES, UNIT
from tests.support.boards.installed_service import CAN, KNOWN, SERIAL, files, install, root, scenario, settings
from tests.support.boards.recorded import plant

__all__ = ["root", "scenario"]  # the fixtures


def test_the_state_of_a_board_as_json(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["board", "--json", "--root", str(root)]) == 0
    reported = json.loads(capsys.readouterr().out)
    assert reported["board"] == "Raspberry Pi 4 Model B"
    assert reported["ports"]["/dev/serial0"] is True
    assert reported["ports"]["/dev/ttyAMA2"] is False
    assert reported["temperature"] == 51.121
    assert reported["profile"]["recommended"]["step"] == 0.0025
    assert reported["profile"]["serial"][0]["device"] == "/dev/serial0"
    assert reported["throttling"] == {"now": [], "before": [], "known": True}


def test_a_dry_run_shows_every_line_and_writes_none(
    root: Path, scenario: str, capsys: pytest.CaptureFixture[str]
) -> None:
    before = files(root)
    assert install(root, scenario, "--dry-run") == 0
    output = capsys.readouterr().out
    assert files(root) == before
    assert install(root, scenario, "--yes") == 0
    for path in (UNIT, RULES, LIMITS):
        assert f"+++ {path}" in output
        assert all(f"+{line}" in output.splitlines() for line in (root / path[1:]).read_text().splitlines())


def test_uninstalling_removes_every_file(root: Path, scenario: str) -> None:
    """A file of somebody else, also one beside ours, is left."""
    Path(scenario).write_text(CAN)
    plant(root, f"{LIMITS[1:]}.mine", "uuv - rtprio 10\n")
    before = files(root)
    assert install(root, scenario, "--yes") == 0
    assert {UNIT[1:], CAN_UNIT[1:], RULES[1:], LIMITS[1:]} == set(files(root)) - set(before)
    assert cli.main(["board", "uninstall", "--root", str(root), "--yes"]) == 0
    assert files(root) == before


def test_a_repeated_installation_changes_only_what_differs(
    root: Path, scenario: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """A CAN unit that is no longer needed is removed."""
    before = files(root)
    assert install(root, scenario, "--yes") == 0
    capsys.readouterr()
    assert install(root, scenario) == 0
    assert "installed already" in capsys.readouterr().out
    Path(scenario).write_text(CAN)
    assert install(root, scenario, "--yes") == 0
    shown = capsys.readouterr().out
    assert f"+++ {CAN_UNIT}" in shown
    assert LIMITS not in shown
    Path(scenario).write_text(SERIAL)
    assert install(root, scenario, "--yes") == 0
    assert f"--- {CAN_UNIT}" in capsys.readouterr().out
    assert not (root / CAN_UNIT[1:]).exists()
    assert cli.main(["board", "uninstall", "--root", str(root), "--yes"]) == 0
    assert files(root) == before


def test_missing_permission_is_one_line_and_nothing_is_written(
    root: Path, scenario: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    before = files(root)
    monkeypatch.setattr("os.access", lambda *_: False)
    assert install(root, scenario, "--yes") == 3
    message = capsys.readouterr().err
    assert re.fullmatch(r"uuv-hil board: /etc/\S+: no permission to write it; run .* with sudo .*\n", message)
    assert files(root) == before


@pytest.mark.parametrize(
    ("user", "message"),
    [
        ("root", "name the user that the slave is to run as; it needs no root"),
        ("nemo", "there is no user 'nemo' here; make one: sudo useradd"),
        ("uuv\nExecStartPre=/bin/evil", "is no valid user"),
    ],
)
def test_root_and_unknown_users_are_refused(
    root: Path, scenario: str, capsys: pytest.CaptureFixture[str], user: str, message: str
) -> None:
    assert cli.main(["board", "install", scenario, "--root", str(root), "--user", user, "--yes"]) == 2
    assert message in capsys.readouterr().err


def test_install_without_a_terminal_and_uninstall_of_nothing_are_refused(
    root: Path, scenario: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stdin.isatty", lambda: False, raising=False)
    assert install(root, scenario) == 2
    assert "--yes" in capsys.readouterr().err
    assert cli.main(["board", "uninstall", "--root", str(root)]) == 2
    assert "nothing is installed on this machine" in capsys.readouterr().err
    assert cli.main(["board", "install", "--root", str(root), "--user", "uuv"]) == 2


def test_files_are_written_only_after_confirmation(root: Path, scenario: str, monkeypatch: pytest.MonkeyPatch) -> None:
    before = files(root)
    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
    monkeypatch.setattr("builtins.input", lambda _: "no")
    assert install(root, scenario) == 0
    assert files(root) == before
    monkeypatch.setattr("builtins.input", lambda _: "y")
    assert install(root, scenario) == 0
    assert files(root) != before


@pytest.mark.parametrize("text", [SERIAL, CAN])
def test_the_units_have_only_settings_that_systemd_has(root: Path, scenario: str, text: str) -> None:
    Path(scenario).write_text(text)
    assert install(root, scenario, "--yes") == 0
    for path in (UNIT, CAN_UNIT) if text == CAN else (UNIT,):
        content = (root / path[1:]).read_text()
        assert "@system-service" in content or path == CAN_UNIT
        assert not re.search(r"@[a-z_]+@", content)
        assert all(key in KNOWN[section].split() for section, key, _ in settings(content))


def test_the_service_unit_starts_the_slave_with_its_rights(root: Path, scenario: str) -> None:
    assert install(root, scenario, "--yes", "--listen", "tcp/0.0.0.0:7447") == 0
    lines = list(settings((root / UNIT[1:]).read_text()))
    values = {key: value for _, key, value in lines}
    assert re.search(r" -m hil\.cli | -c .*'hil\.cli'", values["ExecStart"])  # the latter where Python has no -P
    assert values["ExecStart"].endswith(f" slave {scenario} --listen tcp/0.0.0.0:7447")
    assert os.access(values["ExecStart"].split()[0], os.X_OK)
    assert (values["Type"], values["NotifyAccess"], values["User"]) == ("notify", "main", "uuv")
    assert values["LimitRTPRIO"] == str(LOOP_PRIORITY)
    allowed = [value for _, key, value in lines if key == "DeviceAllow"]
    assert allowed == ["char-ttyS rw", "char-ttyAMA rw", "/dev/cpu_dma_latency w"]
    assert values["MemoryMax"] == "256M"
    assert float(values["WatchdogSec"]) >= 3 * 1.0  # it is fed once a second
    assert 'SYMLINK=="serial0", GROUP="dialout", MODE="0660"' in (root / RULES[1:]).read_text()
    assert (root / UNIT[1:]).stat().st_mode & 0o777 == 0o644


def test_the_can_unit_configures_the_interface(root: Path, scenario: str) -> None:
    Path(scenario).write_text(CAN)
    assert install(root, scenario, "--yes") == 0
    done = [value for _, key, value in settings((root / CAN_UNIT[1:]).read_text()) if key == "ExecStart"]
    assert done == [
        "/sbin/ip link set can0 type can bitrate 500000",
        "-/sbin/ip link set can0 type can restart-ms 100",  # drivers such as gs_usb refuse it
        "/sbin/ip link set can0 up txqueuelen 100",
    ]
    unit = (root / UNIT[1:]).read_text()
    assert "Wants=uuv-hil-can.service\n" in unit
    assert "After=network.target time-sync.target uuv-hil-can.service\n" in unit
    assert re.findall("DeviceAllow=.*", unit) == ["DeviceAllow=/dev/cpu_dma_latency w"]
    Path(scenario).write_text(CAN + "\n[slave]\nstay_awake = false\n")
    assert install(root, scenario, "--yes") == 0
    assert "DeviceAllow" not in (root / UNIT[1:]).read_text()


def test_names_cannot_inject_lines_into_a_unit(root: Path, scenario: str, capsys: pytest.CaptureFixture[str]) -> None:
    Path(scenario).write_text(CAN.replace("can0", "can0 up; rm -r /"))
    assert install(root, scenario, "--yes") == 2
    assert "not valid in a unit" in capsys.readouterr().err
    Path(scenario).write_text('description = "one\\nExecStartPre=/bin/evil"\n' + SERIAL)
    assert install(root, scenario, "--yes") == 0
    assert "\nExecStartPre" not in (root / UNIT[1:]).read_text()


def test_every_rule_for_udev_is_well_formed(root: Path, scenario: str) -> None:
    assert install(root, scenario, "--yes") == 0
    token = r'(ACTION|SUBSYSTEM|KERNEL|SYMLINK|DRIVER|ENV\{DEVTYPE\})=="[^"]+"'
    token += r'|(GROUP|MODE|RUN|ENV\{\w+\}|ATTR\{\w+\})\+?="[^"]+"'
    lines = [line for line in (root / RULES[1:]).read_text().splitlines() if not line.startswith("#")]
    assert len(lines) == 4
    for line in lines:
        parts = line.split(", ")
        assert all(re.fullmatch(token, part) for part in parts), line
        assert any("==" in part for part in parts), f"it would apply to everything: {line}"


@pytest.mark.parametrize("text", [SERIAL, CAN])
def test_systemd_accepts_the_units_where_it_is_installed(root: Path, scenario: str, text: str) -> None:
    """The tests above are all there is without systemd, which is no dependency."""
    Path(scenario).write_text(text)
    assert install(root, scenario, "--yes") == 0
    analyze = shutil.which("systemd-analyze")
    for path in (UNIT, CAN_UNIT) if analyze and text == CAN else (UNIT,) if analyze else ():
        completed = subprocess.run(
            [str(analyze), "verify", "--man=no", str(root / path[1:])], capture_output=True, text=True
        )
        complaints = [line for line in completed.stderr.splitlines() if "uuv-hil" in line]
        assert complaints == []
