"""The table of boards: its formats, its budgets, and one quick real run."""

import json
import os
import re
from pathlib import Path
from typing import Any

import pytest

from boards import load_board
from hil.bench.record import Figure, load, new_record, save
from hil.bench.report import Column
from hil.bench.table import boards as board_table
from hil.bench.table.hil_table import ROWS
from hil.bench.table.run import Run
from hil.cli import main
from hil.commands.bench import table as bench_table
from hil.common.errors import NetworkError
from tests.support.diagnostics import reported

FIRST_CPU = min(os.sched_getaffinity(0))
GOOD = {
    "master_cpu": Figure([2.0, 2.2, 2.1], "% of a core"),
    "startup": Figure([0.100, 0.120, 0.110], "s"),
    "memory": Figure([18.0, 18.2, 18.1], "MiB"),
    "memory_share": Figure([0.44], "%"),
    "delay_p50": Figure([0.5, 0.6, 0.7], "ms"),
    "delay_p99": Figure([1.0, 1.1, 1.2], "ms"),
    "slave_cpu": Figure([4.0, 4.1, 4.2], "% of a core"),
}
BUDGETS = load_board("generic_x86_64").budgets


def test_only_the_same_real_board_is_compared_with_the_paper() -> None:
    pi = "Raspberry Pi 4 Model B"
    line = board_table.ratios(Column("mine", GOOD), pi)
    assert line.startswith("mine against Raspberry Pi 4B, 2022: ")
    assert "start-up to the first sample 32.7 x less" in line
    assert board_table.ratios(Column("mine", GOOD), "x86-64 computer") == ""
    assert board_table.ratios(Column("mine", GOOD, labels=("emulated: x",)), pi) == ""
    doubted = board_table.ratios(Column("mine", GOOD, warnings=("a clock",)), pi)
    assert "start-up" not in doubted
    assert "master CPU" in doubted


def test_a_column_has_the_labels_of_its_record() -> None:
    details = {board_table.HERE: {"slave": {}, "warnings": ["a clock is wrong"]}}
    record = new_record("table", {}, GOOD, ["limited: 25% of a core"], details)
    (column,) = board_table.columns_of(record, "lim")
    assert column.labels[-1] == "limited: 25% of a core"
    assert column.warnings == ("a clock is wrong",)
    assert record.made[:10] in column.about
    elsewhere = {f"{name} @ tcp/a:1": figure for name, figure in GOOD.items()}
    slave: dict[str, str] = {"board": "Raspberry Pi 4B"}
    details = {"tcp/a:1": {"slave": slave}}
    (column,) = board_table.columns_of(new_record("table", {}, elsewhere, ["emulated: x"], details))
    assert "board: Raspberry Pi 4B; master: " in column.about
    assert column.labels[-1] == "master: emulated: x", "of the slave's machine nothing is known"
    slave["labels"] = "emulated: y"
    (column,) = board_table.columns_of(
        new_record("table", {}, elsewhere, ["emulated: x", "slave: emulated: y"], details)
    )
    assert column.labels[-2:] == ("master: emulated: x", "slave: emulated: y")


@pytest.mark.parametrize(
    ("name", "figure", "expected_text"),
    [
        ("startup", Figure([0.36], "s"), "start-up to the first sample: 0.360 s, the budget is 0.350 s"),
        ("memory", Figure([41.0], "MiB"), "slave memory: 41.0 MiB, the budget is 40.0 MiB"),
        ("slave_cpu", Figure([4.0, 5.1, 6.0], "% of a core"), "5.10 % of a core, the budget is 5.00 % of a core"),
        ("delay_p50", Figure([1.01], "ms"), "command delay p50: 1.01 ms, the budget is 1.00 ms"),
        ("delay_p99", Figure([3.1], "ms"), "command delay p99: 3.10 ms, the budget is 3.00 ms"),
        ("startup", Figure([], "s"), "not measured, the budget is 0.350 s"),
    ],
)
def test_a_missed_budget_is_reported(name: str, figure: Figure, expected_text: str) -> None:
    (found,) = board_table.missed(Column("", GOOD | {name: figure}), BUDGETS)
    assert expected_text in found


def test_a_figure_from_a_wrong_clock_misses_its_budget() -> None:
    missed = board_table.missed(Column("", GOOD, warnings=("a clock is wrong",)), BUDGETS)
    assert [line.partition(":")[0] for line in missed] == [
        "start-up to the first sample", "command delay p50", "command delay p99"
    ]  # fmt: skip
    assert all("is not to be trusted: a clock is wrong" in line for line in missed)


def test_the_memory_budget_is_for_a_slave_alone() -> None:
    """A slave beside others has less memory, as shared pages are divided."""
    shared = GOOD | {"memory_alone": Figure([41.0], "MiB")}
    (missed,) = board_table.missed(Column("", shared), BUDGETS)
    assert "alone on its machine: 41.0 MiB, the budget is 40.0 MiB" in missed
    assert board_table.missed(Column("", GOOD | {"memory_alone": Figure([], "MiB")}), BUDGETS) == []


def flown(**slave: Any) -> Run:
    return Run({row.name: GOOD.get(row.name, GOOD["memory"]).median for row in ROWS}, reported(**slave), [], [])


def test_runs_before_a_failed_one_are_saved(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fly(_bench: object, number: int, endpoint: str) -> Run:
        if number == 2 or endpoint.endswith(":2"):
            raise NetworkError("the slave is gone")
        return flown()

    monkeypatch.setattr(bench_table, "fly", fly)
    path = tmp_path / "record.json"
    slaves = ["--connect", "tcp/127.0.0.1:1", "--connect", "tcp/127.0.0.1:2"]
    assert main(["bench", "table", *slaves, "--output", str(path)]) == NetworkError.exit_code
    output = capsys.readouterr().out
    assert "RUN FAILED: tcp/127.0.0.1:1: run 3 of 5: the slave is gone" in output
    assert "medians of up to 5 runs" in output
    assert "RUN FAILED: tcp/127.0.0.1:2: run 1 of 5: the slave is gone" in output
    assert {len(figure.values) for figure in load(str(path)).figures.values()} == {2}
    assert main(["bench", "table", *slaves[2:]]) == NetworkError.exit_code
    assert "the slave is gone" in capsys.readouterr().err


def test_budgets_of_a_slave_on_another_machine_are_those_of_its_board(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The budgets are those of the board that the slave reports; else an option has to name it."""
    slave = {"board": "BeagleBone Black"}
    monkeypatch.setattr(bench_table, "fly", lambda *_: flown(**slave))
    arguments = ["bench", "table", "--repeat", "1", "--check", "--connect", "tcp/127.0.0.1:1"]
    assert main(arguments) == 0
    slave["board"] = "this machine"
    assert main(arguments) == 2
    output = capsys.readouterr().err
    assert "no budgets for tcp/127.0.0.1:1, which says that its board is 'this machine'" in output
    assert "--board NAME: beaglebone_black, " in output
    assert main([*arguments, "--board", "raspberry_pi_4b"]) == 0


def test_one_quick_run_has_plausible_figures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The budgets of memory and processor are a board's; those of time are as long as a busy machine may take."""
    old, new, board = tmp_path / "old.json", tmp_path / "new.json", tmp_path / "patient.toml"
    text = Path("boards/beaglebone_black.toml").read_text()
    board.write_text(re.sub(r'^(startup|delay_p\d+) = ".*"$', r'\1 = "10 s"', text, flags=re.M))
    save(new_record("table", {}, GOOD), str(old))
    options = ["--repeat", "1", "--seconds", "1", "--against", str(old), "--output", str(new), "--check"]
    code = main(["bench", "table", *options, "--board", str(board), "--under", f"taskset -c {FIRST_CPU}"])
    output = capsys.readouterr().out
    assert code == 0, output
    assert "every budget is met" in output
    assert output.count(f"label: limited: run by taskset -c {FIRST_CPU}") == 1
    assert any("old" in line.split() for line in output.splitlines()), "the column of the record that it compares with"
    figures = json.loads(new.read_text())["figures"]
    assert 0.01 < figures["ready"]["median"] < figures["startup"]["median"]
    assert 8.0 < figures["memory"]["median"] < figures["memory_alone"]["median"] < 80.0
    assert 0.0 < figures["delay_p50"]["median"] <= figures["delay_p99"]["median"] <= figures["delay_max"]["median"]
    assert 0.0 < figures["slave_cpu"]["median"] < 90.0
    assert 0.0 < figures["slave_cpu_floor"]["median"] < 90.0


def test_a_missed_budget_is_an_exit_code(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    board = tmp_path / "strict.toml"
    text = Path("boards/beaglebone_black.toml").read_text().replace('memory = "40 MiB"', 'memory = "1 MiB"')
    board.write_text(text)
    monkeypatch.setattr(bench_table, "fly", lambda *_: flown())
    arguments = ["bench", "table", "--repeat", "1", "--check", "--connect", "tcp/127.0.0.1:1"]
    assert main([*arguments, "--board", str(board)]) == 1
    (missed,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("BUDGET MISSED")]
    assert "slave memory" in missed
    assert "the budget is 1.0 MiB" in missed
