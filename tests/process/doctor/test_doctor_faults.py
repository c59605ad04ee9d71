"""A healthy board has no problem; with each planted fault the doctor finds that one, and says what to do."""

import json
import os
import pty
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from boards import load_board
from boards.tree import Tree
from hil.commands import doctor
from hil.doctor import links as doctor_links
from hil.doctor import network as doctor_network
from hil.doctor.findings import Case, User, may_open
from hil.scenario.config import load_scenario
from tests.support.recorded import build, link, plant

SERIAL = """
vehicle = "paper_six"
world = "pool"
stm32 = "device"
[slave]
listen = "tcp/0.0.0.0:7447"
[master]
goal = [8, 7]
"""
CAN = SERIAL + '[link]\nport = "can:socketcan:can0"\nprotocol = "vesc"\nbitrate = 500_000\n'
GOVERNOR = "sys/devices/system/cpu/cpu{}/cpufreq/scaling_governor"
THROTTLED = "commands/vcgencmd_get_throttled"
PASSWD = "root:x:0:0::/root:/bin/sh\nnobody:x:65534:65534::/:/usr/sbin/nologin\n"
TCP = "{:4d}: {}:{:04X} 00000000:0000 {} 00000000:00000000 00:00000000 00000000  1000        0 {} 1 0 100 0 0 10 0\n"


@pytest.fixture
def board(tmp_path: Path) -> Path:
    return build("raspberry_pi_4b", tmp_path / "root")


def examine(root: Path, capsys: pytest.CaptureFixture[str], text: str = SERIAL) -> tuple[int, list[dict[str, str]]]:
    """The exit code, and what is not as it should be."""
    path = root.parent / "mine.toml"
    path.write_text(text)
    plant(root, "etc/passwd", PASSWD)
    code = doctor.main([str(path), "--root", str(root), "--user", "nobody", "--json"])
    found: list[dict[str, str]] = json.loads(capsys.readouterr().out)
    return code, [row for row in found if row["level"] != "ok"]


def can0(root: Path, state: str = "ERROR-ACTIVE", bitrate: int = 500_000, flags: str = "0x40081") -> None:
    """A CAN interface as iproute2 and the kernel describe it."""
    data = {"state": state, "berr_counter": {"tx": 0, "rx": 0}, "restart_ms": 100, "bittiming": {"bitrate": bitrate}}
    told = [{"ifname": "can0", "operstate": "UP", "linkinfo": {"info_kind": "can", "info_data": data}}]
    plant(root, "sys/class/net/can0/flags", f"{flags}\n")
    plant(root, "commands/ip_-details_-json_link_show_can0", json.dumps(told))


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
    plant(root, "proc/812/cmdline", "/usr/sbin/ModemManager\0")
    link(root, "proc/812/fd/9", "/dev/ttyS0")


def powersave(root: Path) -> None:
    for cpu in range(4):
        plant(root, GOVERNOR.format(cpu), "powersave\n")


def under_voltage(root: Path) -> None:
    plant(root, THROTTLED, "throttled=0x10001\n")


def no_realtime(root: Path) -> None:
    limits = (root / "proc/self/limits").read_text()
    plant(root, "proc/self/limits", limits.replace("40                   40", "0                    0"))


def no_realtime_share(root: Path) -> None:
    plant(root, "proc/sys/kernel/sched_rt_runtime_us", "0\n")


def wrong_clock(root: Path) -> None:
    plant(root, "commands/timedatectl_show_--property=NTPSynchronized_--value", "no\n")


def taken_port(root: Path) -> None:
    append(root, "proc/net/tcp", TCP.format(1, "00000000", 7447, "0A", 4711))
    plant(root, "proc/901/cmdline", "zenohd\0--listen\0")
    link(root, "proc/901/fd/12", "socket:[4711]")


def second_port_taken(root: Path) -> None:
    plant(root, "proc/net/tcp6", "header\n" + TCP.format(0, "0" * 32, 7448, "0A", 4712))


def sleepy_wlan(root: Path) -> None:
    plant(root, "commands/iw_dev_wlan0_get_power_save", "Power save: on\n")


def no_memory(root: Path) -> None:
    plant(root, "proc/meminfo", "MemTotal: 3884288 kB\nMemAvailable: 40960 kB\n")


def no_memory_limit(root: Path) -> None:
    plant(root, "sys/fs/cgroup/cgroup.controllers", "cpuset cpu io pids\n")


def test_a_healthy_board_has_no_problem(board: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, found = examine(board, capsys)
    assert code == 0
    assert [(row["level"], row["topic"]) for row in found] == [("note", "security")]


@pytest.mark.parametrize(
    ("fault", "topic", "text", "remedy"),
    [
        (
            no_permission,
            "serial port",
            "/dev/serial0 (/dev/ttyS0): no permission for nobody",
            "usermod -aG dialout nobody",
        ),
        (unplugged, "serial port", "/dev/serial0 (/dev/ttyS0) is not there", "enable_uart=1"),
        (kernel_console, "console", "the kernel's console is on ttyS0", "console="),
        (hidden_console, "console", "the kernel's console is on ttyS0", "console="),
        (login_prompt, "console", "serial-getty@ttyS0", "systemctl disable --now serial-getty@ttyS0.service"),
        (other_process, "port in use", "process 812, /usr/sbin/ModemManager", "kill 812"),
        (powersave, "governor", "powersave on 4 processors", "echo performance"),
        (under_voltage, "throttled", "now: the supply voltage is too low", "power supply"),
        (no_realtime, "real time", "priority 0 is permitted, the slave's loop wants 40", "board install"),
        (no_realtime_share, "real time", "sched_rt_runtime_us is 0", "sysctl"),
        (wrong_clock, "clock", "not synchronised", "timedatectl set-ntp true"),
        (taken_port, "network", "port 7447 is taken by process 901, zenohd --listen", "--listen"),
        (second_port_taken, "network", "port 7448 is taken", "--listen"),
        (sleepy_wlan, "wlan", "wlan0 saves power", "power_save off"),
        (no_memory, "memory free", "40 MiB free, the slave may take 64", "ps aux"),
    ],
)
def test_each_planted_fault(
    board: Path, capsys: pytest.CaptureFixture[str],
    fault: Callable[[Path], None], topic: str, text: str, remedy: str,
) -> None:  # fmt: skip
    fault(board)
    code, found = examine(board, capsys)
    assert code == 1
    (problem,) = [row for row in found if row["level"] == "problem"]
    assert problem["topic"] == topic
    assert text in problem["text"]
    assert remedy in problem["remedy"]


def test_all_faults_at_once(board: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for fault in (no_permission, kernel_console, login_prompt, other_process, powersave, under_voltage,
                  no_realtime, wrong_clock, taken_port, sleepy_wlan):  # fmt: skip
        fault(board)
    _, found = examine(board, capsys)
    assert [row["topic"] for row in found if row["level"] == "problem"] == [
        "serial port", "console", "console", "port in use", "governor", "throttled", "real time", "clock", "network",
        "wlan",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("change", "text", "remedy"),
    [
        (None, "can0 is not there", "dtoverlay=mcp2515-can0"),
        ({"flags": "0x40080"}, "can0 is down", "sudo ip link set can0 up type can bitrate 500000 ("),
        ({"bitrate": 1_000_000}, "runs at 1000000 bit/s, the scenario says 500000", "bitrate = 1000000"),
        (
            {"bitrate": 1_000_000},
            "runs at 1000000 bit/s",
            "can0 down; sudo ip link set can0 up type can bitrate 500000; ",
        ),
        ({"state": "BUS-OFF"}, "can0 is in the state BUS-OFF", "120 ohms"),
        (
            {"state": "BUS-OFF"},
            "BUS-OFF",
            "restart-ms 100 (not every driver can); sudo ip link set can0 up type can bi",
        ),
        ({"state": "ERROR-PASSIVE"}, "can0 is in the state ERROR-PASSIVE", "120 ohms"),
    ],
)
def test_faults_of_a_can_bus(
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


def test_a_healthy_can_bus(board: Path, capsys: pytest.CaptureFixture[str]) -> None:
    can0(board)
    no_permission(board)  # of a port that is not used
    assert examine(board, capsys, CAN)[0] == 0


def test_a_can_bus_without_iproute2(board: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plant(board, "sys/class/net/can0/flags", "0x40081\n")
    code, found = examine(board, capsys, CAN)
    assert code == 0
    assert "bit rate and state cannot be told" in found[0]["text"]


def disabled(root: Path) -> None:
    """As the firmware of a Raspberry Pi has it; a recorded machine may lack /sys/fs/cgroup."""
    append(root, "proc/cmdline", "cgroup_disable=memory")


@pytest.mark.parametrize("fault", [no_memory_limit, disabled])
def test_a_kernel_that_limits_no_memory(
    board: Path, capsys: pytest.CaptureFixture[str], fault: Callable[[Path], None]
) -> None:
    fault(board)
    code, found = examine(board, capsys)
    assert code == 0
    assert [(row["level"], row["topic"]) for row in found] == [("note", "memory limit"), ("note", "security")]
    assert "MemoryMax" in found[0]["text"]
    assert "cgroup_enable=memory" in found[0]["remedy"]
    assert "/boot/firmware/cmdline.txt" in found[0]["remedy"]


def enabled(root: Path) -> None:
    append(root, "proc/cmdline", "cgroup_disable=memory cgroup_enable=memory")


def version_2(root: Path) -> None:
    append(root, "proc/cmdline", "cgroup_disable=memory")
    plant(root, "sys/fs/cgroup/cgroup.controllers", "cpuset cpu io memory pids\n")


def version_1(root: Path) -> None:
    append(root, "proc/cmdline", "cgroup_disable=memory")
    plant(root, "sys/fs/cgroup/memory/cgroup.procs", "")


@pytest.mark.parametrize("change", [enabled, version_2, version_1])
def test_a_kernel_that_limits_memory(
    board: Path, capsys: pytest.CaptureFixture[str], change: Callable[[Path], None]
) -> None:
    change(board)
    assert [row["topic"] for row in examine(board, capsys)[1]] == ["security"]


def test_a_firmware_that_does_not_answer_is_no_good_news(board: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (board / THROTTLED).unlink()
    code, found = examine(board, capsys, SERIAL)
    (note,) = [row for row in found if row["topic"] == "throttled"]
    assert (code, note["level"]) == (0, "note")
    assert "usermod -aG video" in note["remedy"]


def test_notes_are_no_problems(board: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What was, what may be, and what only matters to masters elsewhere."""
    plant(board, THROTTLED, "throttled=0x50000\n")
    plant(board, GOVERNOR.format(0), "ondemand\n")
    plant(board, "sys/class/thermal/thermal_zone0/temp", "77000\n")
    wrong_clock(board)
    sleepy_wlan(board)
    code, found = examine(board, capsys, SERIAL.replace("0.0.0.0", "127.0.0.1"))
    assert code == 0
    assert [row["topic"] for row in found] == ["governor", "throttled", "throttled", "temperature", "clock", "wlan"]


def test_without_a_scenario_nothing_is_a_problem(board: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for fault in (no_permission, kernel_console, other_process, powersave, under_voltage, no_realtime, wrong_clock):
        fault(board)
    plant(board, "etc/passwd", PASSWD)
    assert doctor.main(["--root", str(board), "--user", "nobody"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert sum(line.startswith("note") for line in lines) == 7
    assert not [line for line in lines if line.startswith("problem")]


def test_the_login_prompt_of_jetsons(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    root = build("jetson_nano", tmp_path / "root")
    (root / "dev/ttyTHS1").chmod(0o666)
    code, found = examine(root, capsys)
    assert code == 1
    (problem,) = [row for row in found if row["level"] == "problem"]
    assert problem["remedy"] == "sudo systemctl disable --now nvgetty.service"


@pytest.mark.parametrize(
    ("ports", "remedy"),
    [
        (("dev/ttyTHS0",), 'there is /dev/ttyTHS0: [link] port = "/dev/ttyTHS0" (pins 8 and 10'),
        (("dev/ttyS0",), "see: sudo dmesg | grep tty (pins 8 and 10"),
    ],
)
def test_a_jetson_without_the_port(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], ports: tuple[str, ...], remedy: str
) -> None:
    """With JetPack 5 the port has another name; to end the login prompt would not make one."""
    root = build("jetson_orin_nano_jetpack5", tmp_path / "root")
    for port in (*ports, "etc/systemd/system/multi-user.target.wants/nvgetty.service"):
        plant(root, port, "")
    code, found = examine(root, capsys)
    assert code == 1
    (problem,) = [row for row in found if row["level"] == "problem"]
    assert problem["text"] == "/dev/ttyTHS1 is not there"
    assert problem["remedy"].startswith(remedy)
    assert "with JetPack 5 it is /dev/ttyTHS0" in problem["remedy"]
    assert "systemctl" not in problem["remedy"]


def test_a_user_whom_only_the_recorded_machine_has(board: Path, capsys: pytest.CaptureFixture[str]) -> None:
    port = board / "dev/ttyS0"
    port.chmod(0o660)
    plant(board, "etc/passwd", f"pi-of-the-board:x:4242:{port.stat().st_gid}::/:/bin/sh\n")
    assert doctor.main(["--root", str(board), "--user", "pi-of-the-board"]) == 0
    assert "/dev/serial0 (/dev/ttyS0), pi-of-the-board may open it" in capsys.readouterr().out


def test_an_adapter_that_is_not_there(board: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def remedy() -> str:
        (problem,) = [row for row in examine(board, capsys, text)[1] if row["level"] == "problem"]
        return problem["remedy"]

    text = SERIAL + '[link]\nport = "/dev/ttyUSB0"\n'
    assert remedy() == "connect it; see: ls /dev/serial/by-id/"
    plant(board, "dev/ttyUSB1", "")
    assert remedy() == 'there is /dev/ttyUSB1: [link] port = "/dev/ttyUSB1"'


def test_a_laptops_powersave_is_no_fault(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """intel_pstate's powersave follows the load."""
    root = build("laptop", tmp_path / "root")
    _, found = examine(root, capsys, SERIAL.replace('stm32 = "device"', ""))
    assert "governor" not in {row["topic"] for row in found}


def test_a_step_shorter_than_recommended(board: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _, found = examine(board, capsys, SERIAL.replace("[slave]", '[slave]\nstep = "1 ms"'))
    assert found[0]["topic"] == "step"
    assert "1 ms is shorter than the 2.5 ms" in found[0]["text"]


def test_who_may_open_what(tmp_path: Path) -> None:
    path = tmp_path / "tty"
    path.touch()
    owner = path.stat()
    mine, friend, other = User("a", owner.st_uid, ()), User("b", 4242, (owner.st_gid,)), User("c", 4242, (4242,))
    for mode, allowed in ((0o600, (True, False, False)), (0o660, (True, True, False)), (0o666, (True, True, True))):
        path.chmod(mode)
        expected = allowed if owner.st_uid else (True, *allowed[1:])
        assert tuple(may_open(path.stat(), user) for user in (mine, friend, other)) == expected
    path.chmod(0o066)
    assert may_open(path.stat(), mine) == (owner.st_uid == 0)  # the owner's own bits count, not the group's


def test_the_ports_and_processes_of_this_machine() -> None:
    """The same readers on the living kernel, against a socket of ours."""
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen()
        port = listener.getsockname()[1]
        taken = doctor_network.listeners(Tree("/"))
        inode = Path(f"/proc/self/fd/{listener.fileno()}").readlink()
        assert f"socket:[{taken[port]}]" == str(inode)
    assert port not in doctor_network.listeners(Tree("/"))


def test_a_port_held_by_a_living_process() -> None:
    master, slave = pty.openpty()
    name = os.ttyname(slave)
    os.close(slave)
    code = f"import os, sys; fd = os.open({name!r}, os.O_RDWR | os.O_NOCTTY); print(flush=True); sys.stdin.read()"
    with subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout
        process.stdout.readline()
        scenario = load_scenario("paper_field")
        scenario = scenario._replace(link=scenario.link._replace(port=name))
        case = Case(Tree("/"), load_board("raspberry_pi_4b"), scenario, doctor.find_user(Tree("/"), None))
        (found,) = doctor_links.holders(case)
        assert f"{name} is open in process {process.pid}, {sys.executable}" in found.text
        assert process.stdin
        process.stdin.close()
    assert not [row for row in doctor_links.holders(case) if row.level != "note"]
    os.close(master)
