"""A dead end: a wall with a gap that is wide enough for the path on the map, but too narrow for VFH to enter."""

import pytest

from hil.autonomy.paths.retreat import Retreat
from hil.cases import simulated
from hil.master.avoid import Avoid
from hil.master.flight import prepare
from hil.scenario.config import load_scenario
from sim.environment.obstacles import Box
from sim.environment.world import load_world

WALLS = [(-3.0, 12.2), (15.0, 21.9)]
WORLD = load_world("paper_field")._replace(
    cylinder=(),
    box=tuple([Box(12.0, 0.5 * (west + east), 0.3, east - west) for west, east in WALLS]),
    extent=(-3.0, 28.0, -3.0, 28.0),
)


@pytest.mark.parametrize("backs_out", [True, False])
def test_the_vehicle_backs_out_of_a_dead_end_and_finds_the_way_round(
    backs_out: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not backs_out:
        monkeypatch.setattr(Retreat, "makes_progress", lambda *_: True)
    start = {"start.north": 4.0, "start.east": 12.0, "start.heading": 0.0, "master.goal": [20.0, 12.0]}
    changes = {**start, "planner.vfh": {"safety": 1.5}, "master.time_limit": 150.0 if backs_out else 60.0}
    scenario = load_scenario("path_planning", changes)
    plan = prepare(scenario, WORLD)
    boat = simulated.SimulatedVehicle(scenario, plan.world)
    outcome, _ = simulated.fly(scenario, plan, boat)
    assert outcome.reached == backs_out
    assert outcome.least_clearance > 1.5
    assert boat.simulation.contacts == 0
    assert isinstance(plan.planner, Avoid)
    assert plan.planner.status.startswith("plan 2" if backs_out else "plan 1")
