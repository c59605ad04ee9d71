"""Findings that depend on the kind of machine: Jetsons, laptops, the machine of the test."""

import os
import pty
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from boards import load_board
from boards.resources import describe_process, find_listeners
from boards.tree import Tree
from hil.commands import doctor
from hil.doctor import links as doctor_links
from hil.doctor.findings import Case, User, may_open
from hil.scenario.config import load_scenario
from tests.support.boards.doctor_board import SERIAL, board, examine
from tests.support.boards.recorded import build, plant

__all__ = ["board"]  # the fixtures


def test_the_login_prompt_of_jetsons_is_a_problem(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
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
def test_a_jetson_without_the_port_is_reported_with_the_name_of_another(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], ports: tuple[str, ...], remedy: str
) -> None:
    """The port has another name with JetPack 5; ending the login prompt would not make one."""
    root = build("jetson_orin_nano_jetpack5", tmp_path / "root")
    for port in (*ports, "etc/systemd/system/multi-user.target.wants/nvgetty.service"):
        plant(root, port, "")
    code, found = examine(root, capsys)
    assert code == 1
    (problem,) = [row for row in found if row["level"] == "problem"]
    assert problem["text"] == "/dev/ttyTHS1 does not exist"
    assert problem["remedy"].startswith(remedy)
    assert "with JetPack 5 it is /dev/ttyTHS0" in problem["remedy"]
    assert "systemctl" not in problem["remedy"]


def test_a_laptops_powersave_is_no_fault(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The governor powersave of intel_pstate follows the load."""
    root = build("laptop", tmp_path / "root")
    _, found = examine(root, capsys, SERIAL.replace('stm32 = "device"', ""))
    assert "governor" not in {row["topic"] for row in found}


def test_the_mode_of_a_device_decides_who_may_open_it(tmp_path: Path) -> None:
    path = tmp_path / "tty"
    path.touch()
    owner = path.stat()
    holder, member, other = (User("a", owner.st_uid, ()), User("b", 4242, (owner.st_gid,)), User("c", 4242, (4242,)))
    for mode, allowed in ((0o600, (True, False, False)), (0o660, (True, True, False)), (0o666, (True, True, True))):
        path.chmod(mode)
        expected = allowed if owner.st_uid else (True, *allowed[1:])
        assert tuple(may_open(path.stat(), user) for user in (holder, member, other)) == expected
    path.chmod(0o066)
    assert may_open(path.stat(), holder) == (owner.st_uid == 0)  # the owner's own bits count, not the group's


def test_listening_ports_of_this_machine_are_found() -> None:
    """The same readers on the living kernel, against a socket of ours."""
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen()
        port = listener.getsockname()[1]
        assert (find_listeners(Tree("/")) or {})[port] == os.getpid()
        assert sys.executable in describe_process(Tree("/"), os.getpid())
    assert port not in (find_listeners(Tree("/")) or ())  # nobody else may listen in this network


def test_the_process_that_holds_a_port_is_found() -> None:
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
        (found,) = doctor_links.check_port_users(case)
        assert f"{name} is open in process {process.pid}, {sys.executable}" in found.text
        assert process.stdin
        process.stdin.close()
    assert not [row for row in doctor_links.check_port_users(case) if row.level != "note"]
    os.close(master)
