"""Findings about vehicles: absurd numbers are told, vehicles that exist are not."""

import re
from itertools import cycle
from pathlib import Path

import pytest

from hil.cli import main
from hil.common.schema import preset_names
from hil.doctor.vehicle.rules import RULES, check_vehicle
from hil.doctor.vehicle.subject import Subject
from sim.vehicle.vehicle import Vehicle, load_vehicle

TUTORIAL = Path(__file__).parents[3] / "docs/tutorials/own_vehicle.md"
ROV = TUTORIAL.read_text(encoding="utf-8").split("```toml\n")[1].split("```")[0]


def told(vehicle: Vehicle, density: float = 1000.0) -> dict[str, str]:
    """Return the level of each finding by its key and quantity."""
    findings = [(level, text.split(": ")) for level, text in check_vehicle(Subject(vehicle, {}, density))]
    return {f"{key}: {quantity}": level for level, (key, quantity, *_) in findings}


@pytest.mark.parametrize(
    ("change", "finding"),
    [
        (("inertia = [0.17, 0.26, 0.31]", "inertia = [17, 26, 31]"), "inertia: moment over that of a box .*roll 99.6"),
        (("volume = 0.0115\nneutrally_buoyant = true", "volume = 0.2"), "volume: buoyancy over weight: 17"),
        (("position = [0.15, 0.12, 0.0]", "position = [15, 12, 0]"), "position: distance outside .*: front_right 34"),
        (("[0.0, 0.0, -0.02]", "[0, 0, 0.05]"), "center_of_buoyancy: height above the centre of gravity.*: -0.2, "),
    ],
)
def test_an_absurd_vehicle_is_a_problem_with_a_remedy_for_each_command(
    change: tuple[str, str],
    finding: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("COLUMNS", "1000")
    path, scenario = tmp_path / "bad.toml", tmp_path / "flight.toml"
    assert change[0] in ROV
    path.write_text(ROV.replace(*change), encoding="utf-8")
    scenario.write_text('vehicle = "bad.toml"\nworld = "open_water"\n[master]\ngoal = [20.0, 20.0]\n')
    for command, code in (
        (["vehicle", str(path)], 0),
        (["vehicle", str(path), "--strict"], 1),
        (["scenario", "check", str(scenario)], 1),
    ):
        assert main(command) == code
        found = [line for line in capsys.readouterr().out.splitlines() if line.startswith("problem: ")]
        assert any(re.search(finding, line) and re.search(r"expected .*: \w+ ", line) for line in found), found


def test_the_vehicle_of_the_tutorial_has_no_finding(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "my_rov.toml"
    path.write_text(ROV, encoding="utf-8")
    assert main(["vehicle", str(path), "--strict"]) == 0
    assert capsys.readouterr().out.endswith("\nfindings\n  none\n")


@pytest.mark.parametrize(
    ("name", "density"), list(zip(preset_names("sim/vehicles"), cycle((998.0, 1027.0)), strict=False))
)
def test_a_preset_has_no_warning_in_any_water(name: str, density: float) -> None:
    vehicle, control = load_vehicle(name)
    findings = list(check_vehicle(Subject(vehicle, control, density)))
    assert [finding for finding in findings if finding.level != "note"] == []


def test_bounds_of_problems_contain_those_of_warnings() -> None:
    for rule in RULES:
        assert rule.absurd[0] <= rule.sane[0] < rule.sane[1] <= rule.absurd[1], rule.quantity
