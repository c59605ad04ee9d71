"""Every tool that accepts a vehicle runs with every vehicle, also those with more channels than thrusters."""

import sys
from pathlib import Path

import pytest

from hil.common.schema import preset_names
from tools.costs import step_cost

TOOLS = Path(__file__).parents[3] / "tools"
VEHICLES = preset_names("sim/vehicles")


def test_all_tools_that_accept_a_vehicle_are_tested() -> None:
    found = {path.name for path in TOOLS.rglob("*.py") if '"--vehicle"' in path.read_text()}
    assert found == {"step_cost.py"}


@pytest.mark.parametrize("name", VEHICLES)
def test_the_cost_of_a_step_is_measured(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Costs are measured of Python, C and numpy, which also have to fly the same path."""
    monkeypatch.setattr(sys, "argv", ["step_cost.py", "--vehicle", name, "--rounds", "1"])
    monkeypatch.setattr(step_cost, "STEPS", 5)
    assert step_cost.main() == 0
    assert "numpy" in capsys.readouterr().out
