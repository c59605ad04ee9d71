"""The HIL table: what it computes, and how it shows what it could not measure."""

import json
import math
import re
from typing import Any

import pytest

from hil.bench.table import hil_table as table
from hil.client.client import Stamped
from hil.client.delay import DelayMeter
from hil.common.clock import boot_id
from hil.master.flight import Outcome
from hil.ros.diagnostics import Diagnostics
from sim.run_events import RunEvent
from tests.support.diagnostics import reported

OUTCOME = Outcome(True, "goal reached", 100.0, 70.0, 71.0, 0.3, 0.2, 0.8, cpu_s=2.0)
HEALTH = {
    "boot_id": boot_id(), "cpu_s": 6.0, "cores": 4, "pss_mib": 12.0, "rss_mib": 20.0, "ram_mib": 2048,
    "bytecode_compiled": True, "startup_ready_ms": 40.0, "exec_wall_ns": 1_000_000_000,
    "link_wire": "pty", "link_baud": 115_200, "link_held_baud": 0,
    "link_bytes_out": 2200, "link_messages_out": 100, "link_port": "/dev/pts/9",
}  # fmt: skip


class Client:
    """The part of a client that the table reads."""

    def __init__(self, opened_ns: int, health: Diagnostics, offset_ns: int) -> None:
        self.delays = DelayMeter()
        for number in range(100):
            published = number * 50_000_000
            instants = [number, published, *(published + offset_ns + us * 1000 for us in (200, 250, 350, 400, 300))]
            self.delays.add(instants, published + offset_ns + 420_000, published + 600_000)
        self.opened_wall_ns = opened_ns
        self.latest = {"diagnostics": Stamped(health, 101 * 10**9, 101 * 10**9)}
        self._health = health

    def first_sample_ns(self, exec_wall_ns: int) -> int | None:
        return 1_080_000_000 if exec_wall_ns <= 1_080_000_000 else None

    def diagnostics(self) -> Diagnostics:
        return self._health


def build(opened_ns: int = 0, offset_ns: int = 0, **health: Any) -> table.HilTable:
    client = Client(opened_ns, reported(**HEALTH | health), offset_ns)
    first = table.CpuMark(1.0, 1.0, 1_000_000_000)
    return table.build(client, OUTCOME, first)  # type: ignore[arg-type]  # a stand-in


def test_the_table_computes_its_figures() -> None:
    result = build()
    assert result.master_cpu_core == 0.02
    assert result.slave_cpu_core == 0.05
    assert result.startup_s == 0.08
    assert result.delay.p50_ms == 0.4
    assert [round(hop.p50_ms, 6) for hop in result.hops.values()] == [0.2, 0.05, 0.05, 0.05, 0.05]
    assert result.notes == result.warnings == ()


def test_the_table_is_rendered_as_text(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    text = table.render(build(), "paper_field")
    for expected in (
        "Jetson Nano, 2022  Raspberry Pi 4B, 2022  this run",
        "wire: /dev/pts/9, a pseudo terminal, which carries a frame of 22 bytes at once;",
        "; a UART at 115200 baud would add 1.9 ms",
    ):
        assert expected in text
    assert not re.search(r"\d x|better", text), "loopback here, a wlan there: no ratio"
    elsewhere = table.render(build(), "harbour")
    assert re.search("^command delay p50 .* 0\\.40$", elsewhere, re.M)
    assert "2022" not in elsewhere
    rows = [line.split()[-3:] for line in text.split("\n\n")[0].splitlines()[2:]]
    assert rows == [
        ["42.00", "42.00", "2.00"], ["3.200", "3.600", "0.080"], ["-", "-", "0.040"], ["-", "-", "12.0"],
        ["-", "-", "20.0"], ["37.00", "59.00", "0.98"], ["2000.00", "1900.00", "0.40"], ["-", "-", "0.40"],
        ["-", "-", "0.40"], ["-", "-", "5.00"],
    ]  # fmt: skip
    assert "NO (python -m compileall)" in table.render(build(bytecode_compiled=False), "harbour")


def test_a_slave_that_ran_before_has_no_startup_time() -> None:
    result = build(opened_ns=2_000_000_000)
    assert math.isnan(result.startup_s)
    assert "before this master" in result.notes[0]
    assert json.loads(json.dumps(table.to_json(result, OUTCOME)))["table"]["startup_s"] is None


def test_a_slave_that_was_started_again_has_no_share_of_a_core() -> None:
    """The processor time of such a slave begins again at 0: the difference would be less than nothing."""
    result = build(exec_wall_ns=1_050_000_000)
    assert math.isnan(result.slave_cpu_core)
    assert "restarted" in result.notes[0]
    assert result.startup_s == 0.03, "memory of the slave that runs now"
    assert "nan" not in table.render(result, "harbour")


def test_run_events_are_in_the_table() -> None:
    hit = RunEvent("collision", 9_300_000_000, 10_200_000_000, (6.4, 5.7, 2.0), "the pile at (6.5, 7.5)")
    client = Client(0, reported(**HEALTH), 0)
    outcome = OUTCOME._replace(events=(hit,))
    result = table.build(client, outcome, table.CpuMark(1.0, 1.0, 1_000_000_000))  # type: ignore[arg-type]
    line = "collision with the pile at (6.5, 7.5) 9.3 s after the start, for 10.2 s, at N 6.4 E 5.7 depth 2.0 m"
    assert f"EVENT: {line}" in table.render(result, "harbour").splitlines()
    assert table.to_json(result, outcome)["table"]["events"] == [f"EVENT: {line}"]
    assert not table.to_json(result, outcome)["outcome"]["success"]


@pytest.mark.parametrize("offset_ns", [-5_000_000, 5_000_000, 5_000_000_000])
def test_a_clock_set_between_the_two_starts_is_noted(offset_ns: int) -> None:
    """A slave started before the clock was set reports the same boot and another time, and the table notes it."""
    result = build(offset_ns=offset_ns)
    assert result.clock_offset_ms == pytest.approx(offset_ns / 1e6, abs=1.0)
    assert any(note.startswith("one machine whose clock was set between the two starts") for note in result.notes)
    assert result.warnings == ()
