"""The fault campaign: its quick selection passes, its verdicts fail faulty rows, and decoders survive noise."""

import json
import re
import subprocess
import sys
from math import nan
from pathlib import Path
from typing import get_args

import pytest

from firmware_stub import build
from hil.links.protocols import PROTOCOLS, Role
from tools.faults import campaign, decoders, report
from tools.faults.instruments import instrument_decoders
from tools.faults.links import LINKS, USUAL
from tools.faults.pins import Pins, state_of
from tools.faults.rows import RECOVERY_S, Row, judge

ROOT = Path(__file__).parents[3]
GOOD_ROW = Row("link", "unplugged", USUAL.name, 0.2, USUAL.limit_s, 0.1, 0, "told", "", ())


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "tools.faults", *arguments]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=240)


def test_the_quick_selection_passes_and_is_written(tmp_path: Path) -> None:
    done = run("--quick", "--attempts", "3", "--output", str(tmp_path))
    assert done.returncode == 0, done.stdout + done.stderr
    rows = json.loads((tmp_path / "faults.json").read_text())["rows"]
    assert {row["room"] for row in rows} >= {"link", "process", "network", "disk", "peer", "file"}
    moving = [row for row in rows if row["neutral_s"] is not None]
    assert all(0.0 < row["neutral_s"] < row["limit_s"] < 1.0 and row["stale"] == 0 for row in moving)
    assert any("thruster link lost" in row["reported"] for row in moving)
    assert "| unplugged | python frame pty |" in (tmp_path / "faults.md").read_text()


def test_good_rows_pass() -> None:
    assert judge(GOOD_ROW).passed
    assert judge(GOOD_ROW._replace(room="file", neutral_s=nan, limit_s=nan)).passed, "nothing turns"


@pytest.mark.parametrize(
    ("change", "expected_text"),
    [
        ({"neutral_s": USUAL.limit_s + 0.01}, "the limit is 0.74 s"),
        ({"neutral_s": nan}, "neutral after nan s"),
        ({"recovery_s": RECOVERY_S + 0.1}, "executed commands again after 15.1 s"),
        ({"recovery_s": nan}, "executed commands again not at all"),
        ({"stale": 1}, "1 old commands"),
        ({"leaked": "3 descriptors"}, "left behind: 3 descriptors"),
    ],
)
def test_a_faulty_row_fails_with_the_reason(change: dict[str, object], expected_text: str) -> None:
    row = judge(GOOD_ROW._replace(**change))  # type: ignore[arg-type]
    assert not row.passed
    assert expected_text in row.problems[0]
    assert row.problems[0] in report.line_of(row)
    assert "1 failed" in report.summary([row])


def test_old_commands_are_counted_at_the_outputs() -> None:
    pins = Pins()
    for sequence in (1, 2, 2, 3):
        pins.report([1600] * 6, sequence)
    pins.report([1500] * 6, 4)
    pins.report([1400] * 6, 5)
    assert pins.executed("ahead", 0.0) == 3
    assert pins.executed("astern", 0.0) == 1
    pins.power_lost()
    assert state_of([1400, 1300]) == "astern"
    assert pins.executed("neutral", 0.0) == 3, "the beginning, the stop, the end"
    assert state_of([1600, 1400]) == "other"
    assert state_of([0, 0]) == "neutral", "no pulses at all"


def test_every_link_and_kind_of_fault_is_in_the_full_campaign() -> None:
    plans = campaign.plans(lambda _: True, thorough=True, quick=False)
    assert {plan.link for plan in plans} == set(LINKS)
    rooms = {fault.room for plan in plans for fault in plan.faults}
    assert rooms == {"link", "process", "network", "disk", "memory", "clock", "peer", "address", "driver"}


def test_a_selection_of_nothing_is_refused() -> None:
    done = run("--select", "no such row")
    assert done.returncode == 2
    assert done.stderr == "--select 'no such row': no row matches; see --list\n"


def test_the_firmware_in_c_survives_noise_under_sanitizers() -> None:
    outcome = decoders.firmware(3000, 1)
    assert outcome.fault == ""
    executed = re.search(r"(\d+) commands executed", outcome.remark)
    assert executed
    assert int(executed[1]) > 300, "most inputs carry sound commands"


def test_a_finding_of_a_sanitizer_is_a_fault(tmp_path: Path) -> None:
    """The firmware with too small a buffer must not pass."""
    headers = Path(build.HERE) / "include"
    for header in headers.glob("*.h"):
        (tmp_path / header.name).write_text(header.read_text().replace("PACKET_LONGEST 280u", "PACKET_LONGEST 20u"))
    assert "PACKET_LONGEST 20u" in (tmp_path / "uuv_hil_stm32.h").read_text()
    outcome = decoders.firmware(500, 1, [*build.native_compiler(), f"-I{tmp_path}", *decoders.SANITIZERS])
    assert "runtime error" in outcome.fault or "AddressSanitizer" in outcome.fault


def test_decoders_of_the_network_the_slave_and_instruments_survive_noise() -> None:
    sound_ones = 0
    tables = decoders.slave_decoders(), decoders.network_decoders(), instrument_decoders()
    for name, (decode, sound) in [row for table in tables for row in table.items()]:
        outcome = decoders.feed(name, decode, sound, 300, 1)
        assert outcome.fault == "", f"{name}: {outcome.fault}"
        sound_ones += decode(sound) is not None
    assert sound_ones > 30, "an empty message is not sound to all of them"


@pytest.mark.parametrize("role", get_args(Role))
@pytest.mark.parametrize("kind", PROTOCOLS)
def test_links_survive_noise_and_decode_what_follows(kind: str, role: Role) -> None:
    outcome = decoders.feed_link(kind, role, 5000, 1)
    assert outcome.fault == ""
    assert int(outcome.remark.split()[0]) > 500, "many of the inputs are valid"


def test_a_decoder_that_raises_is_a_fault() -> None:
    outcome = decoders.feed("broken", lambda data: data[7], b"12345678", 100, 1)
    assert "IndexError" in outcome.fault
