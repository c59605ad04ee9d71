"""The cases of one vehicle: in simulated time and, short, with a slave; what they measure and report."""

import math
from pathlib import Path

import pytest

from hil.cases import fidelity
from hil.cases.path_planning import hidden_piles
from hil.cases.record import Result, Run, Track
from hil.cases.single import radius_of, shortest
from hil.cases.task_scheduling import TaskScheduling, visit_orders
from hil.commands import case as command
from hil.common.errors import ConfigError
from hil.master.flight import prepare
from hil.master.tasks import Tasks
from hil.scenario.config import load_scenario
from sim.environment.world import load_world
from sim.vehicle.vehicle import load_vehicle

PAPER_SIX, _ = load_vehicle("paper_six")
RADIUS = radius_of(PAPER_SIX)


def test_hidden_piles_leave_a_passage() -> None:
    import random

    plan = prepare(load_scenario("path_planning"))
    path = plan.planner.track
    endpoints = path[0], path[-1]
    for seed in range(20):
        piles = hidden_piles(plan.world, path, endpoints, random.Random(seed))
        for number, pile in enumerate(piles):
            centre = pile["north"], pile["east"]
            assert plan.world.clearance(*centre) - pile["radius"] >= 2.2
            assert min(math.dist(centre, end) for end in endpoints) > pile["radius"] + 3.0
            for other in piles[:number]:
                assert math.dist(centre, (other["north"], other["east"])) - pile["radius"] - other["radius"] >= 2.2


def test_the_shortest_path_and_the_best_order_are_known_optima() -> None:
    field = load_world("paper_field")
    free = field._replace(cylinder=(), box=())
    assert shortest(free, PAPER_SIX, 5.0, [(0.0, 0.0), (30.0, 40.0)]) == pytest.approx(50.0, rel=1e-3)
    pile = field.cylinder[0]._replace(north=10.0, east=0.0, radius=2.0)
    detour = shortest(free._replace(cylinder=(pile,)), PAPER_SIX, 5.0, [(0.0, 0.0), (20.0, 0.0)])
    reach = 2.0 + RADIUS  # two tangents and the arc between: geometry by hand
    by_hand = 2.0 * math.sqrt(100.0 - reach**2) + reach * (math.pi - 2.0 * math.acos(reach / 10.0))
    assert by_hand < detour < 1.01 * by_hand
    mission = Tasks(
        home=[0.0, 0.0],
        task=[
            {"name": "a", "at": [1.0, 0.0], "duration": 1.0, "needs": ["b"]},
            {"name": "b", "at": [2.0, 0.0], "duration": 1.0},
            {"name": "c", "at": [3.0, 0.0], "duration": 1.0},
        ],
    ).mission
    found = visit_orders(mission)
    assert len(found) == 3
    assert all(order.index((2.0, 0.0)) < order.index((1.0, 0.0)) for order in found)
    assert TaskScheduling("task_scheduling").vary(1) == ({}, {})


def result(**changes: object) -> Result:
    result = Result(
        "path_planning", "sil", 1, True, "there", 10.0, 8.0, 7.5, 8.0 / 7.5, 0.9, False, 1500.0, 0.1, 0.2, 0.3
    )
    return result._replace(**changes)  # type: ignore[arg-type]


def test_fidelity_measures_match_hand_computed_values() -> None:
    """The two paths follow a line 0.3 m apart; the second is slower and cut short."""
    times = [float(i) for i in range(11)]
    one = Track("a", times, [0.8 * t for t in times], [0.0] * 11, [0.8] * 11, [0.8] * 11)
    other = one._replace(north=[0.7 * t for t in times], east=[0.3] * 11)
    slow = result(mode="hil", duration=11.0, energy=1200.0, path_length=7.0, least_clearance=0.8)
    found = fidelity.compare(Run(result(), (one,), ""), Run(slow, (other,), ""))
    assert found == pytest.approx((0.3, 0.3, -0.125, 0.1, -0.2, -0.1))
    assert fidelity.compare(Run(result(), (one,), ""), Run(result(), (one,), "")) == pytest.approx([0.0] * 6, abs=1e-9)


def test_the_command_flies_a_case_and_writes_its_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command.main(["path_planning", "--output", str(tmp_path / "out")]) == 0
    output = capsys.readouterr().out
    assert "1 of 1" in output
    assert "path_planning.png, report.md, results.json" in output
    assert (tmp_path / "out" / "path_planning-sil-001" / "track.csv").stat().st_size > 10_000
    for wrong in (["path_planing"], ["path_planning", "--seeds", "0"], ["all", "--hil", "-1"]):
        with pytest.raises(ConfigError):
            command.main(wrong)
