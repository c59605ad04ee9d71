"""Figures of Zhang et al. 2022 on the page reference_platform.md, compared with the scenarios and the code."""

from pathlib import Path

import pytest

from hil.bench.table.hil_table import PAPER_BOARDS
from hil.scenario.config import load_scenario
from sim.environment.world import load_world
from sim.vehicle.vehicle import load_vehicle
from tests.support.flights.paper_hunt import FORMATIONS, TARGET

PAGE = Path(__file__).parents[3] / "docs/explanation/reference_platform.md"
STATIONS = {"charging": (5.0, 5.0), "acquisition": (53.0, 13.0), "transmission": (15.0, 46.0)}


@pytest.mark.parametrize(
    ("name", "starts"),
    [
        ("target_hunting", FORMATIONS["line"]),
        ("target_hunting_acoustic", FORMATIONS["line"]),
        ("target_hunting_diamond", FORMATIONS["diamond"]),
    ],
)
def test_formations_and_target_are_as_published(name: str, starts: tuple[tuple[float, float], ...]) -> None:
    scenario = load_scenario(name)
    assert tuple((member.north, member.east) for member in scenario.member) == starts
    assert scenario.hunting is not None
    assert tuple(scenario.hunting.target) == TARGET
    assert load_world(scenario.world).extent == (-1.0, 11.0, -1.0, 11.0)


def test_the_path_planning_field_is_as_published() -> None:
    scenario = load_scenario("path_planning")
    assert (scenario.start.north, scenario.start.east) == (0.0, 0.0)
    assert tuple(scenario.master.goal or ()) == (50.0, 50.0)
    south, north, west, east = load_world(scenario.world).extent or (0.0,) * 4
    assert max(south, west) <= 0.0 <= 50.0 <= min(north, east)


def test_the_stations_of_task_scheduling_are_as_published() -> None:
    scenario = load_scenario("task_scheduling")
    tasks = {task["name"]: tuple(task["at"]) for task in scenario.planner["task"]}
    assert tasks == STATIONS
    assert tuple(scenario.planner["home"]) == (scenario.start.north, scenario.start.east) == (0.0, 0.0)
    south, north, west, east = load_world(scenario.world).extent or (0.0,) * 4
    assert all(south < x < north and west < y < east for x, y in tasks.values())


def test_table_1_is_as_published() -> None:
    rows = {board.title: board[2:] for board in PAPER_BOARDS}
    assert rows == {"Jetson Nano": (42.0, 3.2, 37.0, 2000.0), "Raspberry Pi 4B": (42.0, 3.6, 59.0, 1900.0)}
    page = PAGE.read_text()
    for title, (cpu, startup, memory, delay) in rows.items():
        row = next(line for line in page.splitlines() if line.startswith(f"| table 1, {title} |"))
        printed = f"master CPU {cpu:g} %, start-up {startup} s, slave memory {memory:g} %"
        assert f"{printed}, command delay {delay / 1e3:g} s" in row


def test_the_vehicle_has_seven_thrusters_four_of_them_at_right_angles() -> None:
    vehicle, _ = load_vehicle("paper_seven")
    assert len(vehicle.thrusters) == 7
    level = [thruster.direction for thruster in vehicle.thrusters if thruster.direction[2] == 0.0]
    assert len(level) == 4
    front_right, front_left, rear_right, rear_left = level
    for one, other in ((front_right, front_left), (rear_right, rear_left), (front_left, rear_left)):
        assert one[0] * other[0] + one[1] * other[1] == pytest.approx(0.0)
