"""Links and targets of a fleet in the scene, and a plan that replaces another."""

from typing import Any

import numpy as np
import pytest

from hil.autonomy.fleets.hunting import HuntPlan
from hil.ros.fleet import FormationSample
from hil.view.scene.fleet import FleetScene, Hunt
from hil.view.scene.world import WorldScene
from sim.environment.world import World
from tests.support.flights.paper_hunt import FORMATIONS, TARGET
from tests.unit.view.scene_recorder import Recorder

NODES = ("a", "b", "c", "d")
PLAN = HuntPlan(FORMATIONS["line"], TARGET, 1.5, 0.5)
LEVEL = (1.0, 0.0, 0.0, 0.0)


@pytest.fixture
def recorder() -> Recorder:
    return Recorder()


@pytest.fixture
def world(recorder: Recorder) -> WorldScene:
    return WorldScene(recorder, World("pool", "", (0.0, 10.0, 0.0, 10.0), 4.0))


@pytest.fixture
def fleet(recorder: Recorder, world: WorldScene) -> FleetScene:
    return FleetScene(recorder, Hunt(NODES, PLAN, 5.0, 2.0), world)


def positions(*easts: float) -> dict[str, Any]:
    return {node: np.array((east, 0.0, -2.0)) for node, east in zip(NODES, easts, strict=False)}


def reports(clock_s: float) -> dict[str, dict[str, Any]]:
    return {node: {"formation": FormationSample((0.0, 0.0, 2.0), LEVEL, round(clock_s * 1e9))} for node in NODES}


def test_vehicles_within_range_are_joined_by_links(recorder: Recorder, fleet: FleetScene) -> None:
    fleet.draw({}, positions(0.0, 3.0, 6.0, 20.0))
    segments = recorder.added["/fleet/links"][1][0]
    assert sorted(tuple(pair[:, 0].tolist()) for pair in segments) == [(0.0, 3.0), (3.0, 6.0)]
    links = recorder.handles["/fleet/links"]
    fleet.draw({}, positions(0.0, 10.0, 20.0))
    assert links.removed, "no vehicle is in range of another"
    fleet.draw({}, positions(0.0))
    assert "/fleet/places" not in recorder.added, "no report yet"


def test_formation_targets_follow_each_vehicles_reported_clock(recorder: Recorder, fleet: FleetScene) -> None:
    fleet.draw(reports(0.0), positions(0.0, 3.0, 6.0, 9.0))
    first = recorder.added["/fleet/places"][1][0]
    assert first.tolist() == [[east, north, -2.0] for north, east in FORMATIONS["line"]]
    fleet.draw(reports(PLAN.duration), positions(0.0, 3.0, 6.0, 9.0))
    last = recorder.added["/fleet/places"][1][0]
    assert np.hypot(*(last[:, :2] - (TARGET[1], TARGET[0])).T) == pytest.approx(1.5), "on the ring"
    assert recorder.added["/target"][2]["position"].tolist() == [TARGET[1], TARGET[0], -2.0]
    assert {f"/path/{node}" for node in NODES} <= set(recorder.added)


def test_a_new_plan_replaces_the_drawn_one(recorder: Recorder, world: WorldScene) -> None:
    world.draw_path([(0.0, 0.0), (1.0, 1.0)], 2.0)
    plan = ((0.0, 0.0, 1.0), (3.0, 4.0, 1.0), (5.0, 5.0, 1.0))
    world.draw_path(plan, 2.0)
    assert recorder.added["/path"][1][0][:, 1].tolist() == [[4.0, 3.0, -1.0], [5.0, 5.0, -1.0]]
