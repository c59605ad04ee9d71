"""Campaigns: combinations, failures that are rows, a table."""

import csv
import os
import signal
from pathlib import Path

import pytest

from hil.commands import campaign
from hil.errors import ConfigError
from tests.processes import Program, wait_for, write_scenario


def test_combinations() -> None:
    assert campaign.combinations([]) == [{}]
    sets = campaign.combinations(["master.speed=0.5,0.6", "stm32=python"])
    assert sets == [{"master.speed": 0.5, "stm32": "python"}, {"master.speed": 0.6, "stm32": "python"}]


@pytest.mark.parametrize("text", ["master.speed", "=1", "master.speed="])
def test_a_wrong_variation(text: str) -> None:
    with pytest.raises(ConfigError, match="KEY=VALUE"):
        campaign.combinations([text])


def test_a_campaign(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scenario, _ = write_scenario(tmp_path)
    output = tmp_path / "runs.csv"
    arguments = [str(scenario), "--seeds", "2", "--vary", "master.speed=0.4,0.8", "--jobs", "2", "-o", str(output)]
    assert campaign.main(arguments) == 0
    with output.open() as file:
        rows = list(csv.DictReader(file))
    assert [(row["master.speed"], row["seed"]) for row in rows] == [
        ("0.4", "1"),
        ("0.4", "2"),
        ("0.8", "1"),
        ("0.8", "2"),
    ]
    assert all(row["reached"] == "True" for row in rows)
    slow, fast = (float(row["duration"]) for row in rows[1:3])
    assert slow > 1.5 * fast
    assert rows[0]["goal_error"] != rows[1]["goal_error"], "another seed is another run"
    table = capsys.readouterr().out
    assert "master.speed=0.4" in table
    assert "2/2" in table


def test_a_run_that_fails_is_a_row(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scenario, _ = write_scenario(tmp_path)
    assert campaign.main([str(scenario), "--seeds", "1", "--vary", "master.time_limit=3,40", "--jobs", "1"]) == 6
    out = capsys.readouterr().out
    assert "0/1" in out
    assert "1/1" in out
    assert "not reached: time limit" in out


def test_a_wrong_key_is_found_before_anything_runs(tmp_path: Path) -> None:
    scenario, _ = write_scenario(tmp_path)
    with pytest.raises(ConfigError, match=r"sped.*speed"):
        campaign.main([str(scenario), "--vary", "master.sped=1"])


def test_an_output_that_cannot_be_written_is_found_before_anything_runs(tmp_path: Path) -> None:
    scenario, _ = write_scenario(tmp_path)
    (tmp_path / "runs.csv").mkdir()
    with pytest.raises(ConfigError, match=r"runs.csv: cannot be written: Is a directory"):
        campaign.main([str(scenario), "--seeds", "100000", "-o", str(tmp_path / "runs.csv")])


def test_the_table_is_there_even_if_the_disk_is_full(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scenario, _ = write_scenario(tmp_path)
    with pytest.raises(ConfigError, match="No space left"):
        campaign.main([str(scenario), "--seeds", "1", "--jobs", "1", "-o", "/dev/full"])
    assert "1/1" in capsys.readouterr().out


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
@pytest.mark.parametrize("name", ["campaign", "case"])
def test_no_worker_outlives_it(tmp_path: Path, name: str, number: int) -> None:
    what = [write_scenario(tmp_path)[0]] if name == "campaign" else ["path_planning", "--out", tmp_path / "out"]
    with Program(tmp_path, name, *what, "--seeds", "10000", "--jobs", "2") as program:
        assert wait_for(lambda: "2/10000" in program.output or (tmp_path / "out/path_planning-sil-004").exists(), 20)
        assert len(workers(program)) == 2
        program.process.send_signal(number)
        assert program.wait() == 130, program.output
        assert wait_for(lambda: not workers(program), 5)
    assert "Traceback" not in program.output


def workers(program: Program) -> list[str]:
    """The command lines of joblib's processes in the program's session, those that have ended left out."""
    found = []
    for pid in filter(str.isdigit, os.listdir("/proc")):
        try:
            if os.getsid(int(pid)) == program.process.pid:
                found.append(Path(f"/proc/{pid}/cmdline").read_text())
        except OSError:  # it has ended meanwhile
            continue
    return [line for line in found if "LokyProcess" in line]
