"""VFH+ and the guide in closed loop: a point mass among obstacles that are not on the map."""

import math
import random
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from hil.autonomy.control.controller import VelocityCommand
from hil.autonomy.paths.any_angle import plan_any_angle
from hil.autonomy.paths.astar import plan
from hil.autonomy.paths.guide import Guide, GuideSettings, Search
from hil.autonomy.paths.laser_map import LaserMap
from hil.autonomy.paths.occupancy import Extent, OccupancyGrid
from hil.autonomy.paths.vfh import Scan, Vfh, VfhSettings
from hil.common.errors import MissionError

Point = tuple[float, float]
Disc = tuple[float, float, float]  # north, east, radius

RADIUS = 0.25
STEP = 0.2
VFH = VfhSettings(radius=RADIUS)
SETTINGS = GuideSettings(VFH)
FIELD = Extent(-3.0, -3.0, 28.0, 28.0)
BEAMS = 91
FOV = math.radians(240.0)


def scan(discs: list[Disc], position: Point, heading: float, noise: Callable[[], float] = lambda: 0.0) -> Scan:
    """Return what a laser with 240 degrees and 91 beams measures up to 8 m."""
    north, east, radius = np.array(discs or [(1e6, 1e6, 1.0)]).T
    angles = heading - FOV / 2.0 + FOV / (BEAMS - 1) * np.arange(BEAMS)
    along = np.outer(np.cos(angles), north - position[0]) + np.outer(np.sin(angles), east - position[1])
    aside = np.hypot(north - position[0], east - position[1]) ** 2 - along**2
    hit = (aside < radius**2) & (along > 0.0)
    ranges = np.where(hit, along - np.sqrt(np.maximum(radius**2 - aside, 0.0)), np.inf).min(axis=1)
    return Scan(-FOV / 2.0, FOV / (BEAMS - 1), [float(d) + noise() if d < 8.0 else math.inf for d in ranges])


class PointMass:
    """Surge and turn rate follow the command with a lag of 0.3 s."""

    def __init__(self, position: Point, heading: float) -> None:
        self.position, self.heading = position, heading
        self.surge = self.turn_rate = 0.0

    def advance(self, command: VelocityCommand) -> None:
        self.surge += (command.surge - self.surge) * STEP / 0.3
        self.turn_rate += (command.yaw_rate - self.turn_rate) * STEP / 0.3
        self.heading += self.turn_rate * STEP
        north, east = self.position
        self.position = (
            north + self.surge * math.cos(self.heading) * STEP,
            east + self.surge * math.sin(self.heading) * STEP,
        )


def clearance(discs: list[Disc], position: Point) -> float:
    return min((math.dist(position, disc[:2]) - disc[2] for disc in discs), default=math.inf)


def obstacles(seed: int, count: int, kept_free: tuple[Point, ...]) -> list[Disc]:
    """Return discs 2 m or more apart, and 2.5 m from the points to keep free."""
    generator, discs = random.Random(seed), list[Disc]()
    while len(discs) < count:
        disc = generator.uniform(1.0, 24.0), generator.uniform(1.0, 24.0), generator.uniform(0.4, 1.5)
        if all(math.dist(disc[:2], other[:2]) > disc[2] + other[2] + 2.0 for other in discs) and all(
            math.dist(disc[:2], point) > disc[2] + 2.5 for point in kept_free
        ):
            discs.append(disc)
    return discs


def run_guide(guide: Guide, discs: list[Disc], start: Point, seconds: float = 250.0) -> tuple[PointMass, float]:
    boat, least = PointMass(start, 0.7), math.inf
    for _ in range(int(seconds / STEP)):
        command = guide.update(boat.position, boat.heading, scan(discs, boat.position, boat.heading))
        assert 0.0 <= command.surge <= SETTINGS.speed
        assert abs(command.yaw_rate) <= SETTINGS.max_yaw_rate
        boat.advance(command)
        least = min(least, clearance(discs, boat.position))
        if guide.has_arrived:
            break
    return boat, least


def map_of(discs: list[Disc]) -> OccupancyGrid:
    return OccupancyGrid.rasterise(np.vectorize(lambda north, east: clearance(discs, (north, east))), FIELD, 0.25)


@pytest.mark.parametrize(("seed", "search"), [(0, plan), (1, plan_any_angle)])
@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_the_guide_reaches_its_goal_with_all_half_or_no_obstacles_on_the_map(
    search: Search, share: float, seed: int
) -> None:
    start, goal = (0.0, 0.0), (25.0, 24.0)
    discs = obstacles(100 + seed, 14, (start, goal))
    guide = Guide(map_of(discs[: int(share * len(discs))]), start, goal, SETTINGS, search)
    boat, least = run_guide(guide, discs, start)
    assert guide.has_arrived
    assert not guide.stuck
    assert least > RADIUS
    assert math.dist(boat.position, goal) <= SETTINGS.tolerance + 0.1
    assert guide.plans == 1 or share < 1.0


def test_the_guide_leaves_a_dead_end_that_traps_vfh_alone() -> None:
    """The map from scans gives a path back out of a horseshoe, open to the start, and round it."""
    wall = [(12.0 + 5.0 * math.cos(a), 12.0 + 5.0 * math.sin(a), 0.4) for a in np.linspace(-1.1, 2.7, 40)]
    discs = [(n, e, r) for n, e, r in wall]
    start, goal = (10.0, 10.0), (25.0, 25.0)
    guide = Guide(OccupancyGrid.empty(FIELD, 0.25), start, goal, SETTINGS)
    _, least = run_guide(guide, discs, start, 400.0)
    assert guide.has_arrived
    assert guide.plans > 1
    assert least > RADIUS
    boat, vfh = PointMass(start, 0.7), Vfh(VFH)
    for _ in range(800):
        bearing = math.atan2(goal[1] - boat.position[1], goal[0] - boat.position[0])
        boat.advance(vfh.command(scan(discs, boat.position, boat.heading), boat.heading, bearing, 0.5))
    assert math.dist(boat.position, (12.0, 12.0)) < 6.0  # the reason for the map


def test_an_enclosed_guide_stops_and_reports_that_there_is_no_path() -> None:
    ring = [(10.0 + 4.0 * math.cos(a), 10.0 + 4.0 * math.sin(a), 0.5) for a in np.linspace(0.0, 2.0 * math.pi, 40)]
    guide = Guide(OccupancyGrid.empty(FIELD, 0.25), (10.0, 10.0), (25.0, 25.0), SETTINGS)
    boat, least = run_guide(guide, ring, (10.0, 10.0), 120.0)
    assert "no path" in guide.stuck
    assert not guide.has_arrived
    assert least > RADIUS
    assert guide.update(boat.position, boat.heading, scan(ring, boat.position, boat.heading)) == VelocityCommand()
    with pytest.raises(MissionError, match="inside an obstacle"):
        Guide(map_of([(10.0, 10.0, 2.0)]), (10.0, 10.0), (25.0, 25.0), SETTINGS)


def test_a_map_from_scans_has_the_obstacles_at_their_positions() -> None:
    """The map shows two discs, arranged without symmetry, from several places; cells that a beam passed are free."""
    discs: list[Disc] = [(6.0, 2.0, 1.0), (2.0, 7.0, 0.5)]
    laser_map = LaserMap(OccupancyGrid.empty(Extent(-2.0, -2.0, 10.0, 12.0), 0.1), 7.0)
    poses: list[Any] = [
        ((0.0, 0.0), 0.7),
        ((0.0, 10.0), -0.8),
        ((9.0, 9.0), -2.3),
        ((4.0, 4.5), 1.5),
        ((4.0, 4.5), -1.6),
    ]
    for position, heading in poses:
        fresh = laser_map.add(position, heading, scan(discs, position, heading))
        assert len(fresh) > 0 or heading < -1.5
    occupied = (np.argwhere(laser_map.grid.cells) + 0.5) * 0.1 + laser_map.grid.origin
    assert len(occupied) > 30
    errors = [clearance(discs, (float(north), float(east))) for north, east in occupied]
    assert max(map(abs, errors)) < 0.11  # on the rims, to one cell
    ghost = LaserMap(OccupancyGrid.empty(Extent(-2.0, -2.0, 10.0, 12.0), 0.1), 7.0)
    beam = Scan(0.0, 0.1, [3.0])
    assert ghost.add((0.0, 0.0), 0.0, beam).tolist() == [[50, 20]]
    assert not ghost.grid.is_free((3.0, 0.0))
    for _ in range(3):
        ghost.add((0.0, 0.0), 0.0, Scan(0.0, 0.1, [math.inf]))
    assert ghost.grid.is_free((3.0, 0.0))


def test_occupied_cells_of_the_given_map_are_retained() -> None:
    occupancy = OccupancyGrid.empty(Extent(0.0, 0.0, 5.0, 5.0), 0.5)
    occupancy.cells[4, 0] = True
    laser_map = LaserMap(occupancy, 6.0)
    for _ in range(5):
        assert len(laser_map.add((0.25, 0.25), 0.0, Scan(0.0, 0.1, [math.nan]))) == 0
    assert laser_map.grid.cells.sum() == 1
    laser_map.add((0.25, 0.25), math.pi / 2.0, Scan(0.0, 0.1, [2.0]))
    assert occupancy.cells.sum() == 1  # the caller's own map is left alone
