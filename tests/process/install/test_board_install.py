"""Installation of a slave as a service: systemd, udev, network, and refusals before anything is changed.

Tests that need a real systemd are in tests/system/boards/test_whole_board.py.
"""

import os
import pwd
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from boards import load_board
from boards.tree import Tree
from hil.common.children import python_command
from hil.common.errors import ConfigError
from hil.install import check as board_check
from hil.install import units as board_install
from hil.install.units import CAN_UNIT, MANAGER, MODULE_UNIT, RULES, UNIT, Service
from hil.scenario.config import load_scenario
from tests.support.boards.installed_service import (
    CAN,
    KNOWN,
    PASSWD,
    SERIAL,
    executed,
    files,
    install,
    root,
    scenario,
    settings,
    uninstall,
    values,
)
from tests.support.boards.recorded import build, link, plant

__all__ = ["executed", "root", "scenario"]  # the fixtures


def scenario_with_link(port: str, extra_keys: str = "") -> str:
    return SERIAL + f'[link]\nport = "{port}"\n{extra_keys}'


def test_the_service_restarts_until_its_device_exists(root: Path, scenario: str) -> None:
    assert install(root, scenario, "--yes") == 0
    assert values(root, UNIT, "StartLimitIntervalSec") == ["0"]
    assert values(root, UNIT, "StartLimitBurst") == []
    assert 1.0 < float(values(root, UNIT, "RestartSec")[0]) <= 5.0
    assert values(root, UNIT, "RestartPreventExitStatus") == ["2 5"]


def test_the_unit_of_the_oldest_python_ignores_the_current_folder(
    root: Path, scenario: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Python 3.10 has no option -P: the command is longer, but still one line."""
    monkeypatch.setattr(sys, "version_info", (3, 10))
    assert install(root, scenario, "--yes") == 0
    (start,) = values(root, UNIT, "ExecStart")
    python, option, code, *arguments = shlex.split(start)
    assert (python, option) == (sys.executable, "-c")
    assert "del sys.path[0]" in code
    assert arguments[0] == "slave"


@pytest.mark.parametrize(
    ("port", "kinds", "modules", "rule"),
    [
        ("/dev/ttyTHS1", "ttyTHS", "", 'KERNEL=="ttyTHS1"'),
        ("/dev/ttymxc2", "ttymxc", "", 'KERNEL=="ttymxc2"'),
        ("/dev/ttyUSB0", "ttyUSB", "usbserial", 'KERNEL=="ttyUSB0"'),
        ("rs485:/dev/ttyACM0", "ttyACM", "cdc_acm", 'KERNEL=="ttyACM0"'),
        ("/dev/serial0", "ttyS ttyAMA", "", 'SYMLINK=="serial0"'),
        ("/dev/serial/by-id/usb-X-if00", "ttyUSB ttyACM", "usbserial cdc_acm", 'SYMLINK=="serial/by-id/usb-X-if00"'),
        ("/dev/ttySTM32", "ttyACM", "cdc_acm", 'SYMLINK=="ttySTM32"'),
        ("/dev/serial/by-id/usb-there-if00", "ttyACM", "cdc_acm", 'SYMLINK=="serial/by-id/usb-there-if00"'),
        (
            "/dev/serial/by-path/pci-0000:00:14.0-usb-0:1:1.0-port0",
            "ttyS ttyAMA ttyTHS ttyUSB ttyACM",
            "usbserial cdc_acm",
            'SYMLINK=="serial/by-path/pci-0000:00:14.0-usb-0:1:1.0-port0"',
        ),
    ],
)  # fmt: skip
def test_the_unit_allows_the_devices_of_the_link(
    root: Path, scenario: str, port: str, kinds: str, modules: str, rule: str
) -> None:
    """A driver that is not loaded has no devices that could be allowed: it is loaded before."""
    plant(root, "dev/ttyACM0", "")
    link(root, "dev/serial/by-id/usb-there-if00", "../../ttyACM0")
    link(root, "dev/ttySTM32", "ttyACM0")
    Path(scenario).write_text(scenario_with_link(port))
    assert install(root, scenario, "--yes") == 0
    allowed = [f"char-{kind} rw" for kind in kinds.split()] + ["/dev/cpu_dma_latency w"]
    assert values(root, UNIT, "DeviceAllow") == allowed
    wanted = [f"modprobe@{module}.service" for module in modules.split()]
    assert " ".join(values(root, UNIT, "Wants")).split() == wanted
    assert values(root, UNIT, "After")[0].split()[2:] == wanted
    assert f'SUBSYSTEM=="tty", {rule}, GROUP="dialout"' in (root / RULES[1:]).read_text()


def test_a_usb_can_adapter_without_a_kernel_driver_gets_its_rights(
    root: Path, scenario: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Path(scenario).write_text(scenario_with_link("can:gs_usb:0", 'protocol = "vesc"'))
    assert install(root, scenario, "--yes") == 0
    assert "DeviceAllow=" not in capsys.readouterr().out.replace("+DeviceAllow=", "")
    assert "char-usb_device rw" in values(root, UNIT, "DeviceAllow")
    assert 'ATTR{idVendor}=="1d50", ATTR{idProduct}=="606f", GROUP="dialout"' in (root / RULES[1:]).read_text()
    Path(scenario).write_text(scenario_with_link("can:pcan:PCAN_USBBUS1", 'protocol = "vesc"'))
    assert install(root, scenario, "--yes") == 0
    assert "note: the device that can:pcan:PCAN_USBBUS1 opens is known only to python-can" in capsys.readouterr().out


def test_a_can_adapter_at_a_serial_port_gets_its_rights(
    root: Path, scenario: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """python-can accepts a speed after the device name; slcan here is not that of python-can."""
    Path(scenario).write_text(scenario_with_link("can:robotell:/dev/ttyUSB0@115200", 'protocol = "vesc"'))
    assert install(root, scenario, "--yes") == 0
    assert 'SUBSYSTEM=="tty", KERNEL=="ttyUSB0", GROUP' in (root / RULES[1:]).read_text()
    assert values(root, UNIT, "DeviceAllow")[0] == "char-ttyUSB rw"
    Path(scenario).write_text(scenario_with_link("can:slcan:/dev/ttyACM0@115200", 'protocol = "vesc"'))
    assert install(root, scenario, "--yes") == 2
    assert "set baud = 115200 in [link]" in capsys.readouterr().err


def test_a_port_name_that_is_a_pattern_is_refused(
    root: Path, scenario: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Path(scenario).write_text(scenario_with_link("/dev/tty*"))
    assert install(root, scenario, "--yes") == 2
    assert "'/dev/tty*' is not valid in a rule" in capsys.readouterr().err


def test_a_pty_of_another_program_gets_no_rule(root: Path, scenario: str) -> None:
    Path(scenario).write_text(scenario_with_link("/tmp/stm32"))
    assert install(root, scenario, "--yes") == 0
    assert "# No rule: the link uses no serial device." in (root / RULES[1:]).read_text()
    assert values(root, UNIT, "PrivateTmp") == ["no"]


def test_rules_are_applied_at_once(root: Path, scenario: str, executed: list[str]) -> None:
    """The rules are triggered by change events for all devices that they name."""
    Path(scenario).write_text(scenario_with_link("can:gs_usb:0", 'protocol = "vesc"'))
    assert install(root, scenario, "--yes") == 0
    rules = (root / RULES[1:]).read_text()
    (trigger,) = [command for command in executed if command.startswith("udevadm trigger")]
    subsystems = {*re.findall('SUBSYSTEM=="([^"]+)"', rules), "tty", "misc"}  # /dev/cpu_dma_latency is one of misc
    assert subsystems == set(re.findall(r"--subsystem-match=(\S+)", trigger))
    assert all("change" in events.split("|") for events in re.findall('ACTION=="([^"]+)"', rules))
    assert executed.index("udevadm control --reload") < executed.index(trigger)


def test_power_saving_of_the_wlan_is_turned_off(root: Path, scenario: str, executed: list[str]) -> None:
    """The rule holds for any name of the interface, once it has it; NetworkManager does not turn it on again."""
    assert install(root, scenario, "--yes") == 0
    assert os.path.basename(RULES) > "99-com.rules" > "80-net-setup-link.rules"
    assert 'ENV{DEVTYPE}=="wlan", RUN+="/usr/sbin/iw dev $name set' in (root / RULES[1:]).read_text()
    assert not (root / MANAGER[1:]).exists()
    (root / "etc/NetworkManager/conf.d").mkdir(parents=True)
    assert install(root, scenario, "--yes") == 0
    assert "[connection]\nwifi.powersave = 2\n" in (root / MANAGER[1:]).read_text()
    assert os.path.basename(MANAGER) > "default-wifi-powersave-on.conf"
    reload_command = "systemctl try-reload-or-restart NetworkManager"
    assert executed.count(reload_command) == 1
    assert uninstall(root) == 0
    assert executed.count(reload_command) == 2
    assert not (root / MANAGER[1:]).exists()


@pytest.mark.parametrize(("version", "filtered"), [(237, False), (239, True), (252, True)])
def test_system_calls_are_filtered_where_systemd_supports_it(
    root: Path, scenario: str, version: int, filtered: bool
) -> None:
    plant(root, "commands/systemctl_--version", f"systemd {version} ({version}.5-1)\n+PAM +AUDIT")
    assert install(root, scenario, "--yes") == 0
    assert values(root, UNIT, "SystemCallFilter") == (["@system-service"] if filtered else [])


def test_the_kernel_module_of_a_can_interface_is_loaded(tmp_path: Path, scenario: str) -> None:
    """Jetsons have mttcan on a denylist, which modules-load.d and modprobe@.service respect."""
    root = build("jetson_orin_nano", tmp_path / "orin")
    plant(root, "etc/passwd", PASSWD)
    Path(scenario).write_text(CAN)
    assert install(root, scenario, "--yes") == 0
    assert values(root, MODULE_UNIT, "ExecStart") == ["/sbin/modprobe mttcan"]
    assert values(root, CAN_UNIT, "Wants") == ["uuv-hil-module.service"]
    assert all(key in KNOWN[section].split() for section, key, _ in settings((root / MODULE_UNIT[1:]).read_text()))
    Path(scenario).write_text(CAN.replace("can0", "can7"))  # an adapter's
    assert install(root, scenario, "--yes") == 0
    assert not (root / MODULE_UNIT[1:]).exists()
    assert values(root, CAN_UNIT, "Wants") == []


@pytest.mark.parametrize(
    ("listen", "waits"),
    [
        ("tcp/0.0.0.0:7447", False),
        ("tcp/[::]:7447", False),
        ("tcp/127.0.0.1:7447", False),
        ("tcp/localhost:7447", False),
        ("tcp/192.168.3.116:7447", True),
    ],
)
def test_the_service_waits_for_the_network_only_with_a_fixed_address(
    root: Path, scenario: str, listen: str, waits: bool
) -> None:
    assert install(root, scenario, "--yes", "--listen", listen) == 0
    for key in ("Wants", "After"):
        assert ("network-online.target" in " ".join(values(root, UNIT, key)).split()) is waits


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (SERIAL.replace("depth = 2", "depth = 50"), "the seabed of pool is there"),
        (SERIAL + '[slave]\nstep = "20 ms"\n[sensors.imu]\nrate = "60 Hz"\n', "its rate is above 50 Hz"),
    ],
)
def test_a_scenario_that_the_slave_would_refuse_is_not_installed(
    root: Path, scenario: str, capsys: pytest.CaptureFixture[str], text: str, message: str
) -> None:
    Path(scenario).write_text(text)
    before = files(root)
    assert install(root, scenario, "--yes") == 2
    assert message in capsys.readouterr().err
    assert files(root) == before


def test_a_member_of_a_fleet_is_installed(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert install(root, "target_hunting", "--yes") == 2
    assert "say with --member which vehicle this is" in capsys.readouterr().err
    assert install(root, "target_hunting", "--yes", "--member", "uuv2") == 0
    assert values(root, UNIT, "ExecStart")[0].endswith("slave target_hunting --member uuv2")


def test_a_scenario_with_a_camera_is_installed(root: Path, scenario: str) -> None:
    Path(scenario).write_text(SERIAL + "[sensors.camera]\n")
    assert load_scenario(scenario).sensors["camera"].offloaded
    assert install(root, scenario, "--yes") == 0


def service(path: Path, user: str = "nobody") -> Service:
    return Service(load_scenario(str(path)), str(path), user)


def test_the_scenario_is_loaded_as_the_user_of_the_service(
    scenario: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """The user must be able to read Python, the packages, and all files that the scenario names."""
    monkeypatch.setattr(board_check, "PRIVATE_FOLDERS", ("/nowhere/",))
    monkeypatch.setattr("os.geteuid", lambda: 0)
    requested: dict[str, object] = {}

    def run(command: list[str], **options: object) -> subprocess.CompletedProcess[str]:
        requested.update(options, words=command)
        return subprocess.CompletedProcess(command, 1, "", "warning\nmine.toml: cannot be read\n")

    monkeypatch.setattr(subprocess, "run", run)
    nobody_user = pwd.getpwnam("nobody")
    with pytest.raises(ConfigError, match=r"the slave would not start as nobody: mine\.toml: cannot be read$"):
        board_check.check(Tree("/"), service(Path(scenario)))
    assert (requested["user"], requested["group"], requested["cwd"]) == (nobody_user.pw_uid, nobody_user.pw_gid, "/")
    assert requested["words"] == python_command("-c", board_check.CODE, scenario, "", "")
    with pytest.raises(SystemExit, match=r"nothing\.toml: no such file"):
        board_check.main(str(tmp_path / "nothing.toml"), "", "")
    board_check.main(scenario, "tcp/0.0.0.0:7447", "")


def test_the_default_serial_port_of_a_board_has_its_drivers(tmp_path: Path) -> None:
    """The port is the board's when the scenario names none: Raspberry Pis call it serial0."""
    board = load_board("raspberry_pi_4b")
    assert board_install.serial_drivers(Tree(str(tmp_path)), board.uart) == ("ttyS", "ttyAMA")
    assert board_install.serial_drivers(Tree(str(tmp_path)), "") == ()
