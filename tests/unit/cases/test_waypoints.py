"""Waypoints of a scenario, with a depth each: the map of each leg, flights of both kinds of vehicles, findings."""

from math import dist

import pytest

from hil.autonomy.control.controller import VelocityCommand
from hil.cases import simulated
from hil.common.errors import ConfigError
from hil.doctor.scenario.check import check_scenario
from hil.master.flight import Outcome, prepare
from hil.master.planner import Done, Samples
from hil.scenario.config import Scenario, load_scenario
from hil.scenario.records import Master, Waypoint
from hil.scenario.world_map import known_map
from sim.environment.obstacles import Cylinder
from sim.environment.world import World
from sim.vehicle.vehicle import load_vehicle
from tests.support.fin_flights import OPEN, fin_scenario

Place = tuple[float, float, float]


def waypoints(*places: Place) -> list[dict[str, float]]:
    return [dict(zip(Waypoint._fields, place, strict=True)) for place in places]


def fly(scenario: Scenario, world: World) -> tuple[Outcome, list[Place]]:
    """Return the outcome of a flight, and the true positions."""
    plan = prepare(scenario, world)
    vehicle = simulated.SimulatedVehicle(scenario, world)
    track: list[Place] = []
    planned = plan.planner.command

    def command(time: float, samples: Samples) -> VelocityCommand | Done:
        north, east, depth = vehicle.simulation.state.position[:3]
        track.append((north, east, depth))
        return planned(time, samples)

    plan.planner.command = command  # type: ignore[method-assign]
    return simulated.fly(scenario, plan, vehicle)[0], track


def nearest(track: list[Place], place: Place) -> tuple[float, float]:
    """Return the horizontal distance (m) of the nearest point of a track, and its depth error (m)."""
    point = min(track, key=lambda here: dist(here, place))
    return dist(point[:2], place[:2]), abs(point[2] - place[2])


def test_a_rov_dives_along_its_legs_and_straight_down() -> None:
    places = [(8.0, 0.0, 9.0), (8.0, 0.0, 6.0)]
    scenario = fin_scenario("bluerov2", (8.0, 5.0), master_waypoint=waypoints(*places), master_depth=6.0)
    outcome, track = fly(scenario, OPEN)
    assert outcome.success, outcome.verdict
    assert all(near < 0.6 and wrong < 0.5 for near, wrong in (nearest(track, place) for place in places))
    assert all(abs(depth - 5.0 - 0.5 * north) < 0.35 for north, _, depth in track if north < 7.0)
    assert abs(track[-1][2] - 6.0) < 0.1


def test_a_torpedo_dives_from_waypoint_to_waypoint() -> None:
    places = [(60.0, 0.0, 9.0), (60.0, 40.0, 9.0)]
    scenario = fin_scenario("remus100", (20.0, 40.0), master_waypoint=waypoints(*places), master_depth=6.0)
    outcome, track = fly(scenario, OPEN)
    assert outcome.success, outcome.verdict
    assert all(near < 4.0 and wrong < 0.3 for near, wrong in (nearest(track, place) for place in places))
    assert all(abs(depth - 5.0 - north * 4.0 / 60.0) < 0.6 for north, _, depth in track[:500] if north < 55.0)
    assert abs(track[-1][2] - 6.0) < 0.3


def test_the_map_of_a_leg_shows_what_is_at_the_depths_of_that_leg() -> None:
    """A leg dives from 5 m to 15 m: one pile of 10 m height is passed above, the next one is in the way."""
    piles = tuple(Cylinder(north, 0.0, 1.0, 10.0, False, bottom=30.0) for north in (20.0, 80.0))
    world = OPEN._replace(cylinder=piles, depth=20.0)
    master, (vehicle, _) = Master(goal=(100.0, 0.0), resolution=1.0), load_vehicle("bluerov2")
    for course, free in (
        ([(0.0, 0.0, 5.0), (100.0, 0.0, 15.0)], (True, False)),
        ([(0.0, 0.0, 5.0), (100.0, 0.0, 5.0)], (True, True)),
        ([(0.0, 0.0, 15.0), (50.0, 0.0, 15.0), (100.0, 0.0, 5.0)], (False, True)),
    ):
        grid = known_map(master, vehicle, world, None, course)
        assert (grid.is_free((20.0, 0.0)), grid.is_free((80.0, 0.0))) == free
        with pytest.raises(ConfigError, match="seabed"):
            known_map(master, vehicle, world, None, [*course, (0.0, 0.0, 19.9)])


@pytest.mark.parametrize(
    ("vehicle", "places", "text"),
    [
        ("bluerov2", [(20.0, 0.0, 29.9)], "problem: waypoint[0]: depth: 29.9 m, but the seabed there is 30.00 m deep"),
        ("bluerov2", [(20.0, 0.0, 5.0), (30.0, 0.0, 0.0)], "warning: waypoint[1]: depth: 0 m, but the hull of"),
        ("bluerov2", [(20.0, 0.0, 5.0), (22.0, 0.0, 12.0)], "note: waypoint[1]: depth: 7 m over 2.0 m is steeper than"),
        ("bluerov2", [(999.0, 0.0, 5.0)], "problem: the waypoint[0] (999.00 m north, 0.00 m east) is outside the map"),
        ("lauv", [(30.0, 0.0, 25.0)], "warning: waypoint[0]: depth: lauv changes its depth by at most"),
        ("lauv", [(100.0, 0.0, 10.0)], ""),
        (
            "remus100",
            [(10.0, 0.0, 5.0), (70.0, 0.0, 5.0), (70.0, 6.0, 5.0), (10.0, 6.0, 5.0)],
            "warning: waypoint[2]: 6.0 m from the line before, but remus100 needs 28.1 m to turn back",
        ),
        ("remus100", [(10.0, 0.0, 5.0), (70.0, 0.0, 5.0), (70.0, 30.0, 5.0), (10.0, 30.0, 5.0)], ""),
    ],
)
def test_a_check_finds_depths_that_the_vehicle_cannot_fly(vehicle: str, places: list[Place], text: str) -> None:
    goal = (100.0, 60.0)
    scenario = fin_scenario(vehicle, goal, master_waypoint=waypoints(*places), master_time_limit=900.0)
    found = [f"{level}: {words.partition('master: ')[2]}" for level, words in check_scenario(scenario)]
    assert any(line.startswith(text) for line in found) if text else not found, found


def test_waypoints_without_a_goal_and_with_a_planner_that_leaves_them_out_are_reported() -> None:
    with pytest.raises(ConfigError, match="make the last of them the goal"):
        load_scenario("paper_field", {"master": {"waypoint": waypoints((9.0, 9.0, 5.0))}})
    planner = {"class": "hil.master.avoid:Avoid"}
    found = check_scenario(
        load_scenario("path_planning", {"planner": planner, "master.waypoint": waypoints((5, 5, 5))})
    )
    assert any("Avoid does not pass the waypoints" in text for _, text in found)
