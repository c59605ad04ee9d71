"""Errors of a planner in a flight and in a campaign, and output paths."""

import re
from pathlib import Path

import pytest

from tests.support.processes import Program, write_blind_mission


@pytest.fixture
def into_wall(tmp_path: Path) -> Path:
    return write_blind_mission(tmp_path)


@pytest.mark.parametrize("arguments", [("sim", "--fast"), ("demo", "--output", "FOLDER")])
def test_the_traceback_of_a_planner_error_begins_in_the_planner(
    arguments: tuple[str, ...], into_wall: Path, tmp_path: Path
) -> None:
    planner = tmp_path / "blind.py"
    planner.write_text(planner.read_text().replace("return Done('there')", "return open('no/such/file')"))
    where = {"PYTHONPATH": str(tmp_path)}
    command, *others = [word.replace("FOLDER", str(tmp_path / "out")) for word in arguments]
    with Program(tmp_path, command, into_wall, *others, environment=where) as program:
        assert program.wait() == 6, program.output
    _, shown, lines = program.output.partition("an error in blind.py, a file of yours:\nTraceback")
    assert shown
    assert re.findall(r'File "(.+)", line (\d+), in (\w+)', lines) == [(str(planner), "7", "command")]
    assert "FileNotFoundError" in lines


def test_an_error_in_a_planner_is_a_failed_run_of_a_campaign(into_wall: Path, tmp_path: Path) -> None:
    planner = tmp_path / "blind.py"
    planner.write_text(planner.read_text().replace("return Done('there')", "return 1 / 0"))
    where = {"PYTHONPATH": str(tmp_path)}
    with Program(tmp_path, "campaign", into_wall, "--seeds", "2", environment=where) as program:
        assert program.wait() == 6, program.output
    assert "0/2" in program.output
    assert "no success: blind.py:7: ZeroDivisionError: division by zero" in program.output
