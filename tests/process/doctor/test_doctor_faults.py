"""A healthy board has no problem; with each planted fault the doctor finds that one, and says what to do."""

import json
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from hil.commands import doctor
from tests.support.boards.doctor_board import PASSWD, SERIAL, board, examine
from tests.support.boards.recorded import plant, plant_process

__all__ = ["board"]  # the fixtures


CAN = SERIAL + '[link]\nport = "can:socketcan:can0"\nprotocol = "vesc"\nbitrate = 500_000\n'
GOVERNOR = "sys/devices/system/cpu/cpu{}/cpufreq/scaling_governor"
THROTTLED = "commands/vcgencmd_get_throttled"
TCP = "{:4d}: {}:{:04X} 00000000:0000 {} 00000000:00000000 00:00000000 00000000  1000        0 {} 1 0 100 0 0 10 0\n"


def can0(root: Path, state: str = "ERROR-ACTIVE", bitrate: int = 500_000, flags: str = "0x40081") -> None:
    """Plant a CAN interface as iproute2 and the kernel describe it."""
    data = {"state": state, "berr_counter": {"tx": 0, "rx": 0}, "restart_ms": 100, "bittiming": {"bitrate": bitrate}}
    reported = [{"ifname": "can0", "operstate": "UP", "linkinfo": {"info_kind": "can", "info_data": data}}]
    plant(root, "sys/class/net/can0/flags", f"{flags}\n")
    plant(root, "commands/ip_-details_-json_link_show_can0", json.dumps(reported))


def append(root: Path, path: str, text: str) -> None:
    plant(root, path, (root / path).read_text() + text)


def no_permission(root: Path) -> None:
    (root / "dev/ttyS0").chmod(0o600)


def unplugged(root: Path) -> None:
    (root / "dev/ttyS0").unlink()


def kernel_console(root: Path) -> None:
    plant(root, "proc/cmdline", "console=serial0,115200 console=tty1 rootwait\n")


def hidden_console(root: Path) -> None:
    plant(root, "sys/class/tty/console/active", "ttyS0 tty1\n")


def login_prompt(root: Path) -> None:
    plant(root, "etc/systemd/system/getty.target.wants/serial-getty@ttyS0.service", "")


def other_process(root: Path) -> None:
    plant_process(root, 812, "/usr/sbin/ModemManager", fd9="/dev/ttyS0")


def powersave(root: Path) -> None:
    for cpu in range(4):
        plant(root, GOVERNOR.format(cpu), "powersave\n")


def under_voltage(root: Path) -> None:
    plant(root, THROTTLED, "throttled=0x10001\n")


def no_realtime_share(root: Path) -> None:
    plant(root, "proc/sys/kernel/sched_rt_runtime_us", "0\n")


def wrong_clock(root: Path) -> None:
    plant(root, "commands/timedatectl_show_--property=NTPSynchronized_--value", "no\n")


def taken_port(root: Path) -> None:
    append(root, "proc/net/tcp", TCP.format(1, "00000000", 7447, "0A", 4711))
    plant_process(root, 901, "zenohd --listen", fd12="socket:[4711]")


def second_port_taken(root: Path) -> None:
    plant(root, "proc/net/tcp6", "header\n" + TCP.format(0, "0" * 32, 7448, "0A", 4712))


def sleepy_wlan(root: Path) -> None:
    plant(root, "commands/iw_dev_wlan0_get_power_save", "Power save: on\n")


def no_memory(root: Path) -> None:
    text = (root / "proc/meminfo").read_text()
    plant(root, "proc/meminfo", re.sub(r"(?<=MemAvailable:) +\d+", "      40960", text))


def test_a_healthy_board_has_no_problem(board: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, found = examine(board, capsys)
    assert code == 0
    assert [(row["level"], row["topic"]) for row in found] == [("note", "security")]


@pytest.mark.parametrize(
    ("fault", "topic", "text", "remedy"),
    [
        (no_permission, "serial port", "/dev/serial0 (/dev/ttyS0): no permission", "usermod -aG dialout nobody"),
        (unplugged, "serial port", "/dev/serial0 (/dev/ttyS0) does not exist", "enable_uart=1"),
        (kernel_console, "console", "the kernel's console is on ttyS0", "console="),
        (hidden_console, "console", "the kernel's console is on ttyS0", "console="),
        (login_prompt, "console", "serial-getty@ttyS0", "systemctl disable --now serial-getty@ttyS0.service"),
        (other_process, "port in use", "process 812, /usr/sbin/ModemManager", "kill 812"),
        (powersave, "governor", "powersave on 4 processors", "echo performance"),
        (under_voltage, "throttled", "now: the supply voltage is too low", "power supply"),
        (no_realtime_share, "real time", "sched_rt_runtime_us is 0", "sysctl"),
        (wrong_clock, "clock", "not synchronised", "timedatectl set-ntp true"),
        (taken_port, "network", "port 7447 is used by process 901, zenohd --listen", "--listen"),
        (second_port_taken, "network", "port 7448 is used", "--listen"),
        (sleepy_wlan, "wlan", "wlan0: power saving is on", "power_save off"),
        (no_memory, "memory free", "40 MiB free, but the slave may need 64", "ps aux"),
    ],
)
def test_each_planted_fault_is_found(
    board: Path, capsys: pytest.CaptureFixture[str],
    fault: Callable[[Path], None], topic: str, text: str, remedy: str
) -> None:  # fmt: skip
    fault(board)
    code, found = examine(board, capsys)
    assert code == 1
    (problem,) = [row for row in found if row["level"] == "problem"]
    assert problem["topic"] == topic
    assert text in problem["text"]
    assert remedy in problem["remedy"]


@pytest.mark.parametrize(
    ("change", "text", "remedy"),
    [
        (None, "can0 does not exist", "dtoverlay=mcp2515-can0"),
        ({"flags": "0x40080"}, "can0 is down", "sudo ip link set can0 up type can bitrate 500000 ("),
        ({"bitrate": 1_000_000}, "runs at 1000000 bit/s, but the scenario has 500000", "bitrate = 1000000"),
        ({"state": "BUS-OFF"}, "can0 is in the state BUS-OFF", "120 ohms"),
        ({"state": "ERROR-PASSIVE"}, "can0 is in the state ERROR-PASSIVE", "120 ohms"),
    ],
)
def test_each_fault_of_a_can_bus_is_found(
    board: Path, capsys: pytest.CaptureFixture[str], change: dict[str, str] | None, text: str, remedy: str
) -> None:
    if change is not None:
        can0(board, **change)  # type: ignore[arg-type]
    code, found = examine(board, capsys, CAN)
    assert code == 1
    (problem,) = [row for row in found if row["level"] == "problem"]
    assert problem["topic"] == "CAN"
    assert text in problem["text"]
    assert remedy in problem["remedy"]


def test_a_healthy_can_bus_is_no_problem(board: Path, capsys: pytest.CaptureFixture[str]) -> None:
    can0(board)
    no_permission(board)  # of a port that is not used
    assert examine(board, capsys, CAN)[0] == 0


def test_without_a_scenario_nothing_is_a_problem(board: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for fault in (
        no_permission,
        kernel_console,
        other_process,
        powersave,
        under_voltage,
        no_realtime_share,
        wrong_clock,
    ):
        fault(board)
    plant(board, "etc/passwd", PASSWD)
    assert doctor.main(["--root", str(board), "--user", "nobody"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert sum(line.startswith("note") for line in lines) == 7
    assert not [line for line in lines if line.startswith("problem")]
