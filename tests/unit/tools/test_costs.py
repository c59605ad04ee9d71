"""Every tool that accepts a vehicle runs with every vehicle, also those with more channels than thrusters."""

import sys
from pathlib import Path

import pytest

from hil.common.schema import preset_names
from sim.native import SWITCH
from tools.costs import sim_cost, step_cost

TOOLS = Path(__file__).parents[3] / "tools"
VEHICLES = preset_names("sim/vehicles")


def test_all_tools_that_accept_a_vehicle_are_tested() -> None:
    found = {path.name for path in TOOLS.rglob("*.py") if '"--vehicle"' in path.read_text()}
    assert found == {"sim_cost.py", "step_cost.py"}


@pytest.mark.parametrize("name", VEHICLES)
def test_the_cost_of_a_simulation_is_measured(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["sim_cost.py", "--vehicle", name, "--rounds", "1"])
    monkeypatch.setattr(sim_cost, "ROUND_STEPS", 5)
    monkeypatch.setattr(sim_cost, "REAL_TIME_S", 0.005)
    monkeypatch.setenv(SWITCH, "")
    assert sim_cost.main() == 0
    assert capsys.readouterr().out.count("us a step") == 2


@pytest.mark.parametrize("name", VEHICLES)
def test_the_cost_of_a_step_is_measured(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Costs are measured of Python, C and numpy, which also have to fly the same path."""
    monkeypatch.setattr(sys, "argv", ["step_cost.py", "--vehicle", name, "--rounds", "1"])
    monkeypatch.setattr(step_cost, "STEPS", 5)
    assert step_cost.main() == 0
    assert "numpy" in capsys.readouterr().out
