"""The table of boards side by side: its forms, its budgets, and one quick run of the real thing."""

import csv
import io
import json
import os
from pathlib import Path

import pytest

from boards import load_board
from hil.bench import board_table
from hil.bench.board_table import Column
from hil.bench.record import Figure, new_record, save
from hil.cli import main

ONE = min(os.sched_getaffinity(0))
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


def test_text_stands_beside_the_papers() -> None:
    text = board_table.text([*board_table.paper(), Column("mine", GOOD)])
    rows = {line[:38].strip(): line[38:].split("  ") for line in text.splitlines()}
    startup = [cell.strip() for cell in rows["start-up to the first sample (s)"] if cell.strip()]
    assert startup == ["3.200", "3.600", "0.110 (0.020)"]
    delay = [cell.strip() for cell in rows["command delay p50 (ms)"] if cell.strip()]
    assert delay == ["2000.000", "1900.000", "0.600 (0.200)"]
    assert [cell.strip() for cell in rows["command delay max (ms)"] if cell.strip()] == ["-", "-", "-"]


def test_markdown_is_a_table() -> None:
    lines = board_table.markdown([Column("a|b", GOOD)]).splitlines()
    assert {line.count("|") for line in lines} == {3}
    assert lines[0].endswith("| a/b |")


def test_csv_has_a_line_a_figure() -> None:
    rows = list(csv.DictReader(io.StringIO(board_table.comma_separated([Column("mine", GOOD)]))))
    found = {row["figure"]: row for row in rows}
    assert set(found) == set(GOOD)
    assert (found["startup"]["median"], found["startup"]["runs"]) == ("0.11", "3")
    assert found["memory_share"]["spread"] == ""


def test_picture(tmp_path: Path) -> None:
    path = tmp_path / "table.png"
    board_table.draw([*board_table.paper(), Column("mine", GOOD)], str(path))
    assert path.read_bytes().startswith(b"\x89PNG")


def test_budgets_that_are_kept() -> None:
    assert board_table.missed(Column("", GOOD), BUDGETS) == []


@pytest.mark.parametrize(
    ("name", "figure", "words"),
    [
        ("startup", Figure([0.36], "s"), "start-up to the first sample: 0.360 s, the budget is 0.350 s"),
        ("memory", Figure([41.0], "MiB"), "slave memory: 41.0 MiB, the budget is 40.0 MiB"),
        ("slave_cpu", Figure([4.0, 5.1, 6.0], "% of a core"), "5.10 % of a core, the budget is 5.00 % of a core"),
        ("delay_p50", Figure([1.01], "ms"), "command delay p50: 1.010 ms, the budget is 1.000 ms"),
        ("delay_p99", Figure([3.1], "ms"), "command delay p99: 3.100 ms, the budget is 3.000 ms"),
        ("startup", Figure([], "s"), "not measured, the budget is 0.350 s"),
    ],
)
def test_a_budget_that_is_missed(name: str, figure: Figure, words: str) -> None:
    (found,) = board_table.missed(Column("", GOOD | {name: figure}), BUDGETS)
    assert words in found


def test_several_slaves_are_columns_of_one_record() -> None:
    record = new_record("table", {}, {"startup @ tcp/a:1": GOOD["startup"], "startup @ tcp/b:1": GOOD["startup"]})
    assert [column.title for column in board_table.columns_of(record, "old")] == ["old tcp/a:1", "old tcp/b:1"]


def test_one_quick_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    old, new = tmp_path / "old.json", tmp_path / "new.json"
    save(new_record("table", {}, GOOD), str(old))
    options = ["--repeat", "1", "--seconds", "1", "--against", str(old), "--json", str(new), "--cpus", str(ONE)]
    code = main(["bench", "table", *options, "--check", "--board", "beaglebone_black"])
    said = capsys.readouterr().out
    assert code == 0, said  # 0.9 of a core, 3.2 s, 25 ms: only a broken slave takes that here
    assert "every budget is kept" in said
    assert f"label: limited: processor {ONE} only" in said
    assert "old" in said.splitlines()[0]
    figures = json.loads(new.read_text())["figures"]
    assert 0.01 < figures["startup"]["median"] < 3.2
    assert 0.0 < figures["ready"]["median"] < figures["startup"]["median"]
    assert 8.0 < figures["memory"]["median"] < 80.0
    assert 0.0 < figures["delay_p50"]["median"] <= figures["delay_p99"]["median"] <= figures["delay_max"]["median"]
    assert 0.0 < figures["slave_cpu"]["median"] < 90.0
    assert 0.0 < figures["slave_cpu_floor"]["median"] < 90.0


def test_a_missed_budget_is_an_exit_code(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    board = tmp_path / "strict.toml"
    text = Path("boards/beaglebone_black.toml").read_text().replace('memory = "40 MiB"', 'memory = "1 MiB"')
    board.write_text(text)
    assert main(["bench", "table", "--repeat", "1", "--seconds", "1", "--check", "--board", str(board)]) == 1
    missed = [line for line in capsys.readouterr().out.splitlines() if line.startswith("BUDGET MISSED")]
    assert len(missed) == 1
    assert "slave memory" in missed[0]
    assert "the budget is 1.0 MiB" in missed[0]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--repeat", "0"], "--repeat is at least 1"),
        (["--against", "no.json"], "no.json: cannot be read"),
        (["--slave", "tcp/127.0.0.1:1", "--cpus", "0"], "limit a slave started here"),
        (["--cpus", "zero"], "--cpus 'zero'"),
        (["--set", "slave.stop=1"], "did you mean 'step'"),
        (["no_such_scenario"], "no scenario 'no_such_scenario'"),
    ],
)
def test_what_cannot_be_meant(options: list[str], words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "table", *options]) == 2
    said = capsys.readouterr().err
    assert words in said
    assert len(said.strip().splitlines()) == 1


def test_a_benchmark_that_is_none(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "tabel"]) == 2
    assert "there are: table" in capsys.readouterr().err
    assert main(["bench", "--help"]) == 0
    assert "compare" in capsys.readouterr().out
