"""Findings about vehicles: absurd numbers are told, vehicles that exist are not."""

import re
from collections.abc import Callable
from itertools import cycle
from pathlib import Path

import pytest

from hil.cli import main
from hil.common.schema import preset_names
from hil.doctor.vehicle.rules import RULES, check_vehicle
from hil.doctor.vehicle.subject import Subject
from sim.vehicle.ballast import BuoyancyEngine
from sim.vehicle.vehicle import Vehicle, load_vehicle

TUTORIAL = Path(__file__).parents[3] / "docs/tutorials/own_vehicle.md"
ROV = TUTORIAL.read_text(encoding="utf-8").split("```toml\n")[1].split("```")[0]


def told(vehicle: Vehicle, density: float = 1000.0) -> dict[str, str]:
    """Return the level of each finding by its key and quantity."""
    findings = [(level, text.split(": ")) for level, text in check_vehicle(Subject(vehicle, {}, density))]
    return {f"{key}: {quantity}": level for level, (key, quantity, *_) in findings}


def scaled(values: tuple[float, ...], factor: float) -> tuple[float, ...]:
    return tuple([factor * value for value in values])


def with_thrusters(vehicle: Vehicle, factor: float) -> Vehicle:
    limits = [(factor * t.max_forward, factor * t.max_reverse) for t in vehicle.thrusters]
    rows = zip(vehicle.thrusters, limits, strict=True)
    return vehicle._replace(thrusters=tuple([t._replace(max_forward=a, max_reverse=b) for t, (a, b) in rows]))


def without_vertical_thrust(vehicle: Vehicle) -> Vehicle:
    flat = [t for t in vehicle.thrusters if abs(t.unit_direction[2]) < 0.5]
    return vehicle._replace(thrusters=tuple(flat), neutrally_buoyant=False)


@pytest.mark.parametrize(
    ("change", "finding"),
    [
        (("inertia = [0.17, 0.26, 0.31]", "inertia = [17, 26, 31]"), "inertia: moment over that of a box .*roll 99.6"),
        (("volume = 0.0115\nneutrally_buoyant = true", "volume = 0.2"), "volume: buoyancy over weight: 17"),
        (
            ("position = [0.15, 0.12, 0.0]", "position = [15, 12, 0]"),
            "position: distance outside .*: front_right 34.8,",
        ),
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


WRONG: dict[str, tuple[str, Callable[[Vehicle], Vehicle]]] = {
    "inertia of a body that is a point": ("inertia: moment", lambda v: v._replace(inertia=scaled(v.inertia, 0.01))),
    "half a ton": ("volume: buoyancy", lambda v: v._replace(mass=500.0, neutrally_buoyant=False)),
    "size in decimetres": ("volume: displaced", lambda v: v._replace(dimensions=(4.6, 3.4, 25.0))),
    "heavier than its thrust": ("volume: net weight", lambda v: v._replace(mass=20.0, neutrally_buoyant=False)),
    "thrust in grams": ("thrusters: sum", lambda v: with_thrusters(v, 1000.0)),
    "thrust in tons": ("thrusters: top speed ahead", lambda v: with_thrusters(v, 0.001)),
    "gravity far ahead": ("position: dist", lambda v: v._replace(center_of_gravity=(1.0, 0.0, 0.0))),
    "buoyancy ahead": ("center_of_buoyancy: static tilt", lambda v: v._replace(center_of_buoyancy=(0.1, 0.0, -0.02))),
    "no damping of roll": (
        "linear_damping: sum",
        lambda v: v._replace(linear_damping=(9.0, 9.0, 9.0, 0.0, 1.0, 1.0), quadratic_damping=(9.0, 9.0, 9.0, 0, 1, 1)),
    ),
    "slow to turn": (
        "thrusters: time to turn",
        lambda v: v._replace(linear_damping=(10.0, 15.0, 20.0, 0.3, 0.4, 2000.0)),
    ),
    "too stiff for the step": ("linear_damping: velocity", lambda v: v._replace(linear_damping=(1e4,) * 6)),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_every_rule_tells_its_mistake(name: str) -> None:
    quantity, change = WRONG[name]
    assert any(each.startswith(quantity) for each in told(change(load_vehicle("paper_six")[0])))


def test_flights_tell_what_capsizes_or_leaves_its_depth() -> None:
    vehicle = load_vehicle("rexrov")[0]  # so slightly below gravity that no number is absurd
    tipping = told(vehicle._replace(center_of_buoyancy=(0.0, 0.0, 0.03)))
    assert tipping["adrift for 10 s: tilt"] == "warning"
    sinking = without_vertical_thrust(load_vehicle("paper_six")[0])._replace(volume=0.0094)
    assert told(sinking)["under control: error of depth without vertical thrust"] == "note"


def test_gliders_landers_and_surface_craft_are_noted_only() -> None:
    flat = without_vertical_thrust(load_vehicle("paper_six")[0])
    engine = BuoyancyEngine((0.0, 0.0, 0.0), 0.0, 0.00025, 0.0005, 1e-5)
    glider = load_vehicle("remus100")[0]._replace(fins=(), buoyancy_engine=engine)
    for legitimate in (flat._replace(volume=0.02), flat._replace(volume=0.009), glider):
        assert set(told(legitimate).values()) <= {"note"}, told(legitimate)


def test_bounds_of_problems_contain_those_of_warnings() -> None:
    for rule in RULES:
        assert rule.absurd[0] <= rule.sane[0] < rule.sane[1] <= rule.absurd[1], rule.quantity
