"""The HIL table: what it computes, and how it says what it could not measure."""

import json
import math
import re

import pytest

from hil.bench import table
from hil.master.client import Stamped
from hil.master.delay import DelayMeter, quantiles
from hil.master.flight import Outcome
from hil.process import boot_id

OUTCOME = Outcome(True, "goal reached", 100.0, 70.0, 71.0, 0.3, 0.2, 0.8, cpu_s=2.0)
HEALTH = {
    "boot_id": boot_id(), "cpu_s": "6.0", "cores": "4", "pss_mib": "12.0", "rss_mib": "20.0", "ram_mib": "2048",
    "bytecode_compiled": "true", "startup_ready_ms": "40.0", "exec_wall_ns": "1000000000",
    "link_wire": "pty", "link_baud": "115200",
    "link_bytes_out": "2200", "link_messages_out": "100", "link_port": "/dev/pts/9",
}  # fmt: skip


class Client:
    """What the table reads of a client."""

    def __init__(self, dialled_ns: int, health: dict[str, str], offset_ns: int) -> None:
        self.delays = DelayMeter()
        for number in range(100):
            published = number * 50_000_000
            instants = [number, published, *(published + offset_ns + us * 1000 for us in (200, 250, 350, 400))]
            self.delays.add(instants, published + offset_ns + 420_000, published + 600_000)
        self.dialled_wall_ns = dialled_ns
        self.first_sample_wall_ns = 1_080_000_000
        self.latest = {"diagnostics": Stamped(health, 101 * 10**9, 101 * 10**9)}
        self._health = health

    def diagnostics(self) -> dict[str, str]:
        return self._health


def build(dialled_ns: int = 0, offset_ns: int = 0, **health: str) -> table.HilTable:
    client = Client(dialled_ns, HEALTH | health, offset_ns)
    return table.build(client, OUTCOME, first_cpu=(1.0, 1.0))  # type: ignore[arg-type]  # a stand-in


def test_figures() -> None:
    result = build()
    assert result.master_cpu_core == 0.02
    assert result.slave_cpu_core == 0.05
    assert result.slave_cpu_machine == 0.0125
    assert result.startup_s == 0.08
    assert result.delay.p50_ms == 0.4
    assert [round(hop.p50_ms, 6) for hop in result.hops.values()] == [0.2, 0.05, 0.1, 0.0, 0.05]
    assert result.notes == result.warnings == ()


def test_a_label_of_the_slave_stands_below_the_figures() -> None:
    assert "label: emulated: x" in table.render(build(labels="emulated: x")).splitlines()
    assert "label" not in table.render(build())


def test_text() -> None:
    text = table.render(build())
    for word in (
        "2.0% of a core",
        "0.080 s",
        "20.0 MiB, 0.98% of 2 GiB (12.0 MiB PSS)",
        "p50 0.40 ms",
        "40 x",
        "4,750 x",
        "1.9 ms",
    ):
        assert word in text
    assert "NO (python -m compileall)" in table.render(build(bytecode_compiled="false"))


def test_what_could_not_be_had_is_no_number() -> None:
    before = build(dialled_ns=2_000_000_000)
    nothing = quantiles([])
    text = table.render(before._replace(delay=nothing, hops=dict.fromkeys(before.hops, nothing)))
    assert "nan" not in text
    assert "p50 -, p99 -, max -" in text
    assert re.search(r"start-up +3\.2 s, 3\.6 s +- to the first sample", text)


def test_a_mission_without_path_and_goal_says_nothing_of_them() -> None:
    there = OUTCOME._replace(path_length=math.nan, goal_error=math.nan, cross_track_max=math.nan)
    assert there.summary == "71.0 m travelled, at least 0.80 m from every obstacle"
    assert "m from the goal" in OUTCOME.summary


def test_a_slave_that_ran_before_has_no_startup_time() -> None:
    result = build(dialled_ns=2_000_000_000)
    assert math.isnan(result.startup_s)
    assert "before this master" in result.notes[0]
    assert json.loads(json.dumps(table.to_json(result, OUTCOME)))["table"]["startup_s"] is None


def test_two_machines_are_said_to_be_two() -> None:
    result = build(boot_id="another")
    assert "two machines" in result.notes[0]
    assert result.clock_uncertainty_ms > 0


@pytest.mark.parametrize("offset_ns", [-5_000_000, 5_000_000, 5_000_000_000])
def test_a_clock_that_is_wrong_on_one_machine_is_said(offset_ns: int) -> None:
    """The slave was started before the clock was set: same boot, another time."""
    result = build(offset_ns=offset_ns)
    assert any("ms off, though it should be the master's" in text for text in result.warnings)
    assert f"WARNING: {result.warnings[0]}" in table.render(result)
    assert table.to_json(result, OUTCOME)["table"]["warnings"]
