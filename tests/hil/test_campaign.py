"""Campaigns: combinations, failures that are rows, a table."""

import csv
from pathlib import Path

import pytest

from hil.commands import campaign
from hil.errors import ConfigError
from tests.processes import write_scenario


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
