"""Cases of one vehicle that fly for long in simulated time."""

from itertools import pairwise
from pathlib import Path

from hil.cases.case import find_case
from hil.cases.path_planning import PathPlanning
from hil.cases.variant import write_variant
from hil.scenario.config import load_scenario
from sim.environment.world import load_world
from tests.process.cases.test_cases import RADIUS, check


def test_obstacles_that_the_map_lacks_are_seen_and_passed(tmp_path: Path) -> None:
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


def test_tasks_in_the_order_they_need(tmp_path: Path) -> None:
    result = find_case("task_scheduling").fly("sil", 1, str(tmp_path)).result
    check(result, at_work=45.0)
    assert result.reason == "home after charging, acquisition, transmission"
    times = [result.extra[f"{name} done"] for name in ("charging", "acquisition", "transmission")]
    assert times == sorted(times)
    assert times[0] > 20.0 + 6.0  # there, and its duration
    assert result.duration > times[-1] + 50.0


def test_without_any_map(tmp_path: Path) -> None:
    """Obstacle-unknown mode: an empty map, and the laser alone finds the way through the field."""
    case = PathPlanning()
    case.scenario = write_variant("path_planning", str(tmp_path), {"master.map": "unknown"})
    run = case.fly("sil", 1, str(tmp_path))
    assert run.result.success
    assert run.tracks[0].plan == ((0.0, 0.0), (50.0, 50.0))  # straight through, as far as it knows
    assert run.result.ratio < 1.3
