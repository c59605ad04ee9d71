"""Line of sight along Dubins legs, on a vehicle that turns on circles and drifts with the current."""

import math
from typing import Any

import numpy as np
import pytest

from hil.autonomy.control.controller import wrap
from hil.autonomy.paths.astar import plan, smooth
from hil.autonomy.paths.curves import Chain
from hil.autonomy.paths.dubins import Pose
from hil.autonomy.paths.line_of_sight import LineOfSight, approach_on, circle_around, depths_along, dubins_legs, outline
from hil.autonomy.paths.occupancy import Extent, OccupancyGrid, Point
from hil.autonomy.paths.trajectory import Limits
from hil.common.errors import NoPathError

DT = 0.05
SPEED, RADIUS = 1.5, 12.0
LIMITS = Limits(speed=SPEED, yaw_rate=SPEED / 10.0, climb_angle=0.2, turn_radius=RADIUS)


class Torpedo:
    """A vehicle at constant speed through the water, whose turn rate follows with a lag."""

    def __init__(self, heading: float, current: Point = (0.0, 0.0)) -> None:
        self.north = self.east = self.rate = 0.0
        self.heading, self.current, self.travelled = heading, current, 0.0

    def course(self) -> float:
        north = SPEED * math.cos(self.heading) + self.current[0]
        return math.atan2(SPEED * math.sin(self.heading) + self.current[1], north)

    def step(self, wanted: float) -> None:
        self.rate += (max(-LIMITS.yaw_rate, min(LIMITS.yaw_rate, wanted)) - self.rate) * DT / 0.8
        self.heading += self.rate * DT
        self.north += (SPEED * math.cos(self.heading) + self.current[0]) * DT
        self.east += (SPEED * math.sin(self.heading) + self.current[1]) * DT
        self.travelled += SPEED * DT


def open_water(pose: Pose, goal: Point = (100.0, 0.0)) -> list[tuple[float, float, float]]:
    return [pose.position, (*goal, 5.0)]


@pytest.mark.parametrize("heading", [0.0, 1.6, 3.1, -1.6])
@pytest.mark.parametrize("current", [(0.0, 0.0), (0.0, 0.5), (-0.5, 0.0), (0.4, -0.4)])
def test_the_goal_is_passed_within_the_tolerance(heading: float, current: Point) -> None:
    torpedo = Torpedo(heading, current)
    sight = LineOfSight(
        lambda pose: dubins_legs(open_water(pose), pose.heading, LIMITS),
        Pose((0.0, 0.0, 5.0), heading), SPEED, LIMITS, lookahead=RADIUS, tolerance=2.0,
    )  # fmt: skip
    while not sight.has_arrived:
        torpedo.step(sight.update((torpedo.north, torpedo.east, 5.0), torpedo.heading, torpedo.course()).yaw_rate)
        assert torpedo.travelled < 500.0
    assert math.dist((torpedo.north, torpedo.east), (100.0, 0.0)) <= 2.1
    assert sight.progress == 1.0


def test_a_goal_that_is_missed_is_approached_again() -> None:
    """The vehicle is carried 6 m off the path just before the goal; nothing counts there but another approach."""
    sight = LineOfSight(
        lambda pose: dubins_legs(open_water(pose), pose.heading, LIMITS),
        Pose((0.0, 0.0, 5.0), 0.0), SPEED, LIMITS, lookahead=RADIUS, tolerance=2.0,
    )  # fmt: skip
    torpedo = Torpedo(0.0)
    while not sight.has_arrived and torpedo.travelled < 500.0:
        torpedo.step(sight.update((torpedo.north, torpedo.east, 5.0), torpedo.heading).yaw_rate)
        if sight.approaches == 1 and torpedo.north > 97.0:
            torpedo.east = 6.0
    assert sight.has_arrived
    assert sight.approaches == 2
    assert math.dist((torpedo.north, torpedo.east), (100.0, 0.0)) <= 2.1


def test_legs_turn_no_tighter_and_dive_no_steeper_than_the_limits_through_every_point() -> None:
    points = [(0.0, 0.0, 5.0), (60.0, 0.0, 10.0), (60.0, 40.0, 20.0), (0.0, 40.0, 5.0)]
    chain = dubins_legs(points, 2.0, LIMITS)
    for piece in chain.pieces:
        assert abs(piece.heading_rate) <= 1.0 / RADIUS + 1e-9
        assert abs(piece.slope) <= LIMITS.climb_angle + 1e-9
    places = [chain.at(chain.length * number / 4000).position for number in range(4001)]
    for point in points:
        assert min(math.dist(point, place) for place in places) < 0.1
    assert chain.at(0.0).heading == 2.0


def test_legs_avoid_obstacles_and_stay_on_a_closed_map() -> None:
    def distance(north: Any, east: Any) -> Any:
        return np.hypot(north - 50.0, east) - 10.0

    grid = OccupancyGrid.rasterise(distance, Extent(-8.0, -60.0, 115.0, 60.0), 1.0)
    goal = (100.0, 0.0)

    def approach(pose: Pose) -> Chain:
        return approach_on(grid, lambda start: smooth(grid, plan(grid, start, goal)), pose, (*goal, 5.0), LIMITS)

    path = outline(approach(Pose((0.0, 0.0, 5.0), 0.0)).pieces, 0.5)
    assert min(distance(*point[:2]) for point in path) > -1.0
    with pytest.raises(NoPathError, match=r"no free path with turns of 12\.0 m"):
        approach(Pose((0.0, 0.0, 5.0), math.pi))  # the turn reaches 12 m to the south
    grid.is_open = True
    assert min(north for north, *_ in outline(approach(Pose((0.0, 0.0, 5.0), math.pi)).pieces)) < -10.0


@pytest.mark.parametrize(("dive", "depths"), [(6.0, [5.0, 5.5, 10.0, 11.0]), (60.0, [5.0, 7.4413, 25.4413, 65.0])])
def test_depths_are_those_of_the_straight_line_but_no_steeper_than_the_vehicle(
    dive: float, depths: list[float]
) -> None:
    corners = [(0.0, 0.0), (10.0, 7.0), (100.0, 7.0), (120.0, 0.0)]
    points = depths_along(corners, (0.0, 0.0, 5.0), (120.0, 0.0, 5.0 + dive), math.atan(0.2))
    assert [depth for _, _, depth in points] == pytest.approx(depths, abs=1e-3)


@pytest.mark.parametrize("start", [(0.0, 0.0), (40.0, 10.0)])
def test_a_vehicle_circles_around_a_place(start: Point) -> None:
    torpedo = Torpedo(0.0, (0.2, 0.0))
    torpedo.north, torpedo.east = start
    for number in range(int(200.0 / DT)):
        here = torpedo.north, torpedo.east
        torpedo.step(circle_around((10.0, 0.0), here, torpedo.course(), SPEED, LIMITS, RADIUS).yaw_rate)
        if number * DT > 100.0:
            assert math.dist(here, (10.0, 0.0)) == pytest.approx(RADIUS, abs=4.0)
    assert abs(wrap(torpedo.rate)) > 0.05
