"""Garbage in the files of a machine: the doctor reports that it cannot determine a fact, or omits it."""

import json
import os
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from boards import load_board
from boards.tree import Tree
from hil.commands import doctor
from hil.doctor.findings import Case, Finding, User
from hil.scenario.config import Scenario, load_scenario
from tests.support.boards.recorded import build, plant, plant_process
from tests.support.examples import examples

IP = "commands/ip_-details_-json_link_show_can0"
FLAGS = "sys/class/net/can0/flags"
SOCKET = "header\n 0: {} 00000000:0000 0A 0:0 00:0 0 1000 0 {} 1 0\n"


def scenario(port: str) -> Scenario:
    plain = load_scenario("paper_field")
    link = plain.link._replace(port=port, bitrate=500_000)
    return plain._replace(link=link, slave=plain.slave._replace(listen="tcp/0.0.0.0:7447"))


SCENARIOS = [scenario("/dev/serial0"), scenario("can:socketcan:can0")]


def examine(tree: Tree) -> list[Finding]:
    user = User("nobody", 65534, (65534,))
    cases = [Case(tree, load_board("raspberry_pi_4b"), one, user) for one in SCENARIOS]
    return [finding for case in cases for finding in doctor.findings(case)]


@pytest.fixture
def board(tmp_path: Path) -> Path:
    root = build("raspberry_pi_4b", tmp_path / "root")
    plant(root, FLAGS, "0x40081\n")
    return root


def can(details: object) -> str:
    return json.dumps([{"linkinfo": {"info_kind": "can", "info_data": details}}])


@pytest.mark.parametrize(
    ("path", "text"),
    [
        ("proc/meminfo", "MemAvailable:"),
        ("proc/meminfo", "MemAvailable: much kB\n"),
        ("proc/meminfo", f"MemAvailable: {'9' * 5000} kB\n"),
        ("proc/net/tcp", SOCKET.format("00000000:????", 4711)),
        ("proc/net/tcp6", SOCKET.format("nothing", 4711)),
        ("proc/cmdline", "console=a\0b,115200 console=,\n"),
        (FLAGS, "up"),
        (FLAGS, ""),
        (IP, ""),
        (IP, "[" * 100_000),
        (IP, "[null]"),
        (IP, '[{"linkinfo": null}]'),
        (IP, '[{"linkinfo": {"info_kind": null}}]'),
        (IP, can(None)),
        (IP, can([])),
        (IP, can({"state": "ERROR-ACTIVE", "bittiming": None})),
        (IP, can({"state": "ERROR-ACTIVE", "bittiming": [500_000]})),
        (IP, can({"state": None, "bittiming": {"bitrate": 500_000}})),
        ("etc/group", "root\n:::\n"),
        ("commands/iw_dev_wlan0_get_power_save", "command failed: No such device (-19)\n"),
        ("commands/timedatectl_show_--property=NTPSynchronized_--value", "perhaps\n"),
        ("commands/vcgencmd_get_throttled", "throttled=very\n"),
        ("etc/systemd/system/uuv-hil.service", "User=nobody\nLimitRTPRIO=high\n"),
        ("sys/fs/cgroup/cgroup.controllers", "\0memory\0"),
    ],
)
def test_unreadable_files_cause_no_problem_report(board: Path, path: str, text: str) -> None:
    """There is no traceback, and no problem is reported for text that cannot be parsed."""
    healthy = {row.topic for row in examine(Tree(str(board))) if row.level == "problem"}
    assert {"CAN"}.isdisjoint(healthy)
    plant(board, path, text)
    assert {row.topic for row in examine(Tree(str(board))) if row.level == "problem"} <= healthy


@pytest.mark.parametrize(
    ("details", "texts"),
    [
        ({"state": "ERROR-ACTIVE", "bittiming": None}, ["bit rate and state are unknown"]),
        ({"state": "BUS-OFF", "bittiming": None}, ["bit rate and state are unknown", "BUS-OFF"]),
        ({"bittiming": {"bitrate": 250_000}}, ["bit rate and state are unknown", "runs at 250000 bit/s"]),
    ],
)
def test_incomplete_can_details_are_reported_as_far_as_known(board: Path, details: object, texts: list[str]) -> None:
    plant(board, IP, can(details))
    found = [row.text for row in examine(Tree(str(board))) if row.topic == "CAN"]
    assert len(found) == len(texts)
    assert all(part in text for part, text in zip(texts, found, strict=True))


# Parts that readers search for, and unexpected parts next to them.
PIECES = [
    "\n", " ", ":", "=", "\t", "\0", "0x", "-1", "0A", "ff", "1e999", "nan", "9" * 400, "²", "é", "\ud800", "\x1b[2J",
    "MemAvailable:", "kB",
    "header\n", " 0: 00000000:1D17 00000000:0000 0A 0 0 0 0 0 0\n", "console=", "../..", "Power save: on", "yes", "no",
    "throttled=", '[{"linkinfo": {"info_kind": "can", "info_data": ', '{"bittiming": ', '{"bitrate": ', "null", "{}",
    "[", "]", "}", '"state": ', '"BUS-OFF"', ", ", "User=nobody\nLimitRTPRIO=", "dialout:x:20:", "performance",
]  # fmt: skip
garbage = st.lists(st.sampled_from(PIECES), max_size=12).map("".join)


class Garbled(Tree):
    """A recorded machine whose every file and command may have other content."""

    def __init__(self, root: str, draw: Callable[[], str | None]) -> None:
        super().__init__(root)
        self.draw = draw

    def text(self, name: str) -> str:
        drawn = self.draw()
        return super().text(name) if drawn is None else drawn.strip(" \t\r\n\0")

    def run(self, *command: str) -> str | None:
        return self.draw()


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> str:
    root = build("raspberry_pi_4b", tmp_path_factory.mktemp("garbage") / "root")
    plant(root, FLAGS, "0x40081\n")
    return str(root)


@examples(75)
@given(data=st.data())
def test_any_text_in_any_file_gives_printable_lines(recorded: str, data: st.DataObject) -> None:
    for finding in examine(Garbled(recorded, lambda: data.draw(st.none() | garbage))):
        text = doctor.line(finding)
        text.encode()
        assert text.isprintable(), "one line, without control characters of terminals"


@examples(75)
@given(meminfo=garbage, tcp=garbage, tcp6=garbage, stat=garbage, command=garbage)
def test_any_text_in_the_files_that_psutil_reads(recorded: str, **texts: str) -> None:
    root = Path(recorded)
    plant_process(root, 812, "cat", fd9="/dev/ttyS0")
    paths = {"meminfo": "meminfo", "tcp": "net/tcp", "tcp6": "net/tcp6", "stat": "812/stat", "command": "812/cmdline"}
    for name, text in texts.items():
        (root / "proc" / paths[name]).write_text(text, errors="surrogatepass")
    assert "port in use" in {finding.topic for finding in examine(Tree(recorded))}


def test_a_folder_in_place_of_a_file_is_no_error(board: Path) -> None:
    for path in ("proc/meminfo", "proc/net/tcp", FLAGS):
        (board / path).unlink(missing_ok=True)
        os.makedirs(board / path)
    assert examine(Tree(str(board)))
