"""Cases of one vehicle with long flights in simulated time."""

import math
from pathlib import Path

from hil.cases.flights import fly_all, fly_one
from hil.cases.path_planning import PathPlanning
from hil.cases.record import Result
from hil.cases.single import radius_of
from hil.scenario.variant import write_variant
from sim.vehicle.vehicle import load_vehicle

RADIUS = radius_of(load_vehicle("paper_six")[0])


def check(result: Result) -> None:
    """Check what holds for every flight of one vehicle that succeeds."""
    assert result.success, result.reason
    assert not result.collided
    assert result.least_clearance > RADIUS
    assert 1.0 <= result.ratio < 1.1
    assert 0.6 < result.path_length / result.duration < 0.85  # m/s, of 0.8 commanded
    assert 10.0 < result.energy / result.duration < 300.0  # W
    assert result.cross_track_rms < result.cross_track_max < 1.5
    assert 0.0 < result.planner_cpu < 0.1


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


def test_path_planning_without_a_map(tmp_path: Path) -> None:
    """Obstacle-unknown mode: an empty map, and the laser alone detects the obstacles."""
    case = PathPlanning("path_planning")
    case.scenario = write_variant("path_planning", str(tmp_path), {"master.map": "unknown"})
    run = case.fly("sil", 1, str(tmp_path))
    assert run.result.success
    assert run.tracks[0].plan == ((0.0, 0.0), (50.0, 50.0))  # straight through, as far as it knows
    assert run.result.ratio < 1.3
