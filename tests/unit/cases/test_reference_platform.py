"""Figures of Zhang et al. 2022 on the page reference_platform.md, compared with the scenarios and the code."""

from itertools import pairwise
from math import hypot, isclose, pi, tan
from pathlib import Path
from random import Random

import pytest

from hil.autonomy.control.allocation import Allocator
from hil.autonomy.fleets.formation import Body, FieldSettings, attraction, communication, repulsion
from hil.bench.table.hil_table import PAPER_BOARDS
from hil.scenario.config import load_scenario
from sim.environment.world import load_world
from sim.sensors.error import ErrorModel, ErrorProcess
from sim.vehicle.thrusters.bank import wrench_matrix
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
    assert rows == {"Jetson Nano": (0.42, 3.2, 0.37, 2.0), "Raspberry Pi 4B": (0.42, 3.6, 0.59, 1.9)}
    page = PAGE.read_text()
    for title, (cpu, startup, memory, delay) in rows.items():
        row = next(line for line in page.splitlines() if line.startswith(f"| table 1, {title} |"))
        printed = f"master CPU {cpu:.0%}, start-up {startup} s, slave memory {memory:.0%}, command delay {delay:g} s"
        assert printed.replace("%", " %") in row


def test_the_vehicle_has_seven_thrusters_four_of_them_at_right_angles() -> None:
    vehicle, _ = load_vehicle("paper_seven")
    assert len(vehicle.thrusters) == 7
    level = [thruster.direction for thruster in vehicle.thrusters if thruster.direction[2] == 0.0]
    assert len(level) == 4
    front_right, front_left, rear_right, rear_left = level
    for one, other in ((front_right, front_left), (rear_right, rear_left), (front_left, rear_left)):
        assert one[0] * other[0] + one[1] * other[1] == pytest.approx(0.0)


def equation_13_as_printed(angle: float, radius: float, surge: float, sway: float, yaw: float) -> list[float]:
    """Return the thrusts of thrusters 1 to 4 by equation (13)."""
    cot, lever = 1.0 / tan(angle), radius * (tan(angle) + 1.0) / tan(angle)
    rows = ((1, cot, -lever), (1, -cot, lever), (1, -cot, -lever), (1, cot, lever))
    return [a * surge + b * sway + c * yaw for a, b, c in rows]


@pytest.mark.parametrize("axis", range(3))
def test_equation_13_at_45_degrees_has_our_patterns(axis: int) -> None:
    motion = [float(axis == number) for number in range(3)]
    matrix = wrench_matrix(load_vehicle("paper_six")[0])
    wrench = (motion[0], motion[1], 0.0, 0.0, 0.0, motion[2])
    thrusts, _ = Allocator(matrix, [1e6] * 6, [1e6] * 6).allocate(wrench)
    front_right, front_left, rear_right, rear_left = thrusts[:4]
    thrusts = [rear_right, rear_left, front_right, front_left]
    printed = equation_13_as_printed(pi / 4.0, 0.2, *motion)
    scale = thrusts[0] / printed[0]
    assert scale > 0.0
    assert [scale * value for value in printed] == pytest.approx(thrusts)


def test_equation_12_contradicts_equation_13() -> None:
    """Thruster 3 has + V_y and + W_z in (12), - V_y and - W_z in (13)."""
    angle, radius = pi / 3.0, 0.2
    lever = radius * (tan(angle) + 1.0) / tan(angle)
    for motion, twelve in (((0.0, 1.0, 0.0), 1.0 / tan(angle)), ((0.0, 0.0, 1.0), lever)):
        assert equation_13_as_printed(angle, radius, *motion)[2] == pytest.approx(-twelve)


def test_equation_5_is_ours_near_the_target() -> None:
    settings = FieldSettings()
    pull = attraction((0.3, -0.2), (0.0, 0.0), settings.attraction, settings.conic)
    assert pull == pytest.approx((-0.3 * settings.attraction, 0.2 * settings.attraction))


def test_equation_7_attracts_as_printed_and_ours_repels() -> None:
    x, y, gain, reach = 0.4, 0.3, 0.12, 0.9

    def potential(x: float) -> float:
        return 0.5 * gain * (1.0 / hypot(x, y) - 1.0 / reach) ** 2

    r = hypot(x, y)
    printed = -gain * x * (1.0 / r - 1.0 / reach) * r**-3
    gradient = (potential(x + 1e-6) - potential(x - 1e-6)) / 2e-6
    assert isclose(printed, gradient, rel_tol=1e-6), "and not minus the gradient"
    assert printed < 0.0 < repulsion((x, y), (5.0, 0.3), Body((0.0, 0.0), 0.0), gain, reach)[0]


def test_equation_8_is_discontinuous_as_printed_and_ours_is_not() -> None:
    settings = FieldSettings()
    reach, at = settings.communication_range, settings.comfortable

    def repulsion_at(distance: float) -> float:
        return communication((0.0, 0.0), (distance, 0.0), settings.communication, at, reach)[0]

    assert repulsion_at(at - 1e-9) == 0.0
    assert repulsion_at(at + 1e-6) == pytest.approx(0.0, abs=1e-6)
    assert repulsion_at(at + 0.2) < repulsion_at(at + 0.5) < repulsion_at(reach - 0.1)
    assert repulsion_at(reach + 1e-9) == 0.0, "a neighbour out of range has no effect"


def test_the_bias_is_a_gauss_markov_process_unlike_equation_2() -> None:
    """Equation 2 as printed, n' = -1/tau, gives a bias that falls by t / tau wherever it began."""
    process = ErrorProcess(ErrorModel(bias=1.0, bias_time=10.0), 1.0, Random(2))
    bias = [process.measure(0.0) for _ in range(20_000)]
    mean = sum(bias) / len(bias)
    following = sum(a * b for a, b in pairwise(bias)) / sum(a * a for a in bias)
    assert mean == pytest.approx(0.0, abs=0.2)
    assert following == pytest.approx(0.9048, abs=0.02)  # exp(-1 / 10)
