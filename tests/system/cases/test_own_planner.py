"""The tutorial's planner of ten lines, run unchanged: in simulated time and over the network."""

import json
import re
import sys
from pathlib import Path

import pytest

from hil.cases.simulated import fly
from hil.common.errors import ConfigError, MissionError
from hil.common.tables import parse_toml
from hil.master.flight import prepare
from hil.scenario.config import load_scenario
from tests.support.processes import ROOT, Program, write_scenario


def from_tutorial(language: str) -> str:
    section = (ROOT / "docs" / "tutorials" / "own_planner.md").read_text()
    found = re.search(rf"```{language}\n(.*?)```", section, re.DOTALL)
    assert found, f"the tutorial shows no {language} there"
    return found[1]


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    (tmp_path / "straight.py").write_text(from_tutorial("python"))
    path, _ = write_scenario(tmp_path)
    text = path.read_text().replace("goal = [8, 7]\n", "") + from_tutorial("toml")
    path.write_text(text.replace("north = 4\neast = 4", "north = 6\neast = 3"))
    return path


def test_the_planner_has_ten_lines_as_the_tutorial_states() -> None:
    lines = [line for line in from_tutorial("python").split("class ")[1].splitlines() if line.strip()]
    assert len(lines) == 10
    assert parse_toml(from_tutorial("toml"))["planner"]["class"] == "straight:Straight"


def test_the_planner_flies_in_simulated_time_and_over_the_network(tmp_path: Path, scenario: Path) -> None:
    environment = {"PYTHONPATH": str(tmp_path)}
    folder = tmp_path / "run"
    with (
        Program(tmp_path, "demo", scenario, "--output", folder, environment=environment) as demo,
        Program(tmp_path, "sim", scenario, "--fast", environment=environment) as simulated,
    ):
        assert simulated.wait() == 0, simulated.output
        assert demo.wait() == 0, demo.output
    assert re.search(r"^goal reached after \d+", simulated.output)
    outcome = json.loads((folder / "table.json").read_text())["outcome"]
    assert outcome["reached"]
    assert outcome["reason"] == "goal reached"
    assert outcome["success"]
    assert 1.5 < outcome["travelled"] < 2.6  # it ends 0.5 m from the target, which is 2.2 m away
    assert outcome["least_clearance"] > 0.3


def test_mistakes_of_a_planner_are_reported(tmp_path: Path, scenario: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(tmp_path))
    name = str(scenario)
    assert fly(load_scenario(name), prepare(load_scenario(name)))[0].reason == "goal reached"
    for planner, messages in (
        ({"class": "straight:Straight", "east": 1.0}, "does not take these keys"),
        ({"class": "straight:Strait"}, "straight has no 'Strait'"),
        ({"class": "hil.common.clock:Histogram"}, "has no method 'begin'"),
        ({"class": "hil.master.avoid:Avoid", "serch": "astar"}, "no key 'serch'; did you mean 'search'"),
        ({"north": 1.0}, 'expected a table with class = "module:Class"'),
    ):
        with pytest.raises(ConfigError, match=re.escape(messages)):
            prepare(load_scenario(name, {"planner": planner}))


@pytest.mark.parametrize("returned", ["None", "5", "VelocityCommand(surge=float('nan'))", "VelocityCommand(surge='a')"])
def test_a_planner_that_returns_no_command_ends_the_flight(
    returned: str, tmp_path: Path, scenario: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The flight used to go on with nan to the time limit, and the others ended in a traceback."""
    monkeypatch.syspath_prepend(str(tmp_path))
    text = (tmp_path / "straight.py").read_text()
    (tmp_path / "crooked.py").write_text(re.sub(r"return VelocityCommand\(.*\)", f"return {returned}", text))
    scenario.write_text(scenario.read_text().replace("straight:Straight", "crooked:Straight"))
    monkeypatch.delitem(sys.modules, "crooked", raising=False)
    with pytest.raises(MissionError, match=r"planner crooked:Straight: command\(\) returned .* it returns a Velocity"):
        fly(load_scenario(str(scenario)), prepare(load_scenario(str(scenario))))
