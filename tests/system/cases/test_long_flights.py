"""Cases of one vehicle with long flights in simulated time."""

import math
from itertools import pairwise
from pathlib import Path

from hil.cases.case import find_case
from hil.cases.flights import fly_all, fly_one
from hil.cases.path_planning import PathPlanning
from hil.scenario.config import load_scenario
from hil.scenario.variant import write_variant
from sim.environment.world import load_world
from tests.process.cases.test_cases import RADIUS, check


def test_path_planning_of_two_seeds_is_equal_on_one_and_two_processes(tmp_path: Path) -> None:
    (tmp_path / "one").mkdir()
    (tmp_path / "many").mkdir()
    runs = fly_all("path_planning", str(tmp_path / "many"), [1, 2], jobs=2)
    for run in runs:
        check(run.result)
        assert run.result.goal_error < 0.8  # 0.5 by its own navigation, which errs by 0.1 m and more
    assert [run.result.seed for run in runs] == [1, 2]
    assert runs[0].result.optimum > 70.7  # the diagonal, in the way of which things stand
    assert math.dist(runs[0].tracks[0].points[0], (0.0, 0.0)) < 0.1
    assert math.dist(runs[1].tracks[0].points[0], (0.0, 0.0)) > 0.1
    again = fly_one("path_planning", "sil", 2, str(tmp_path / "one"))
    assert again.tracks == runs[1].tracks, "alone or with others, a seed is the same to the last bit"
    first, second = again.result, runs[1].result
    assert first[: first.index(first.goal_error) + 1] == second[: second.index(second.goal_error) + 1]


def test_obstacles_missing_in_the_map_are_detected_and_passed(tmp_path: Path) -> None:
    run = find_case("path_planning_unknown").fly("sil", 3, str(tmp_path))
    check(run.result)
    world = load_world(load_scenario(run.scenario).world)
    hidden = [pile for pile in world.cylinder if pile.hidden]
    assert len(hidden) == 5
    along = [
        (a[0] + s / 50 * (b[0] - a[0]), a[1] + s / 50 * (b[1] - a[1]))
        for a, b in pairwise(run.tracks[0].plan)
        for s in range(50)
    ]
    hit = [pile for pile in hidden if min(pile.separation(*point)[0] for point in along) < RADIUS]
    assert len(hit) >= 3, "the way that the map shows leads into three of them"
    assert run.result.extra["plans"] > 1


def test_tasks_are_done_in_their_required_order(tmp_path: Path) -> None:
    result = find_case("task_scheduling").fly("sil", 1, str(tmp_path)).result
    check(result, at_work=45.0)
    assert result.reason == "home after charging, acquisition, transmission"
    times = [result.extra[f"{name} done"] for name in ("charging", "acquisition", "transmission")]
    assert times == sorted(times)
    assert times[0] > 20.0 + 6.0  # there, and its duration
    assert result.duration > times[-1] + 50.0


def test_path_planning_without_a_map(tmp_path: Path) -> None:
    """Obstacle-unknown mode: an empty map, and the laser alone detects the obstacles."""
    case = PathPlanning()
    case.scenario = write_variant("path_planning", str(tmp_path), {"master.map": "unknown"})
    run = case.fly("sil", 1, str(tmp_path))
    assert run.result.success
    assert run.tracks[0].plan == ((0.0, 0.0), (50.0, 50.0))  # straight through, as far as it knows
    assert run.result.ratio < 1.3
