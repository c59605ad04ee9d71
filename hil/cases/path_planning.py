"""Path planning case: cross a field of 50 m x 50 m, with A* on the map and VFH+ around scanned obstacles."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from math import cos, dist, pi, sin
from random import Random
from typing import Any

from hil.autonomy.paths.occupancy import Point
from hil.cases.single import SingleCase
from hil.common.errors import ConfigError
from hil.master.flight import Plan, prepare
from hil.master.planner import Planner
from hil.scenario.config import Scenario, load_scenario
from hil.scenario.variant import Table
from sim.environment.world import World

PILES = 5  # not on the map
PILE_RADIUS_M = (0.3, 0.9)
GAP_M = 2.2  # least distance between a pile and other obstacles
CLEAR_M = 3.0  # least distance between a pile and start or goal


class PathPlanning(SingleCase):
    """Path planning with every obstacle on the map. Seeds vary the start, and the heading up to 60 degrees."""

    headings = pi / 4.0, pi / 3.0

    def routes(self, scenario: Scenario, plan: Plan) -> list[list[Point]]:
        """Return the goal as the only place."""
        return [[scenario.master.goal or (0.0, 0.0)]]


class PathPlanningUnknown(PathPlanning):
    """Path planning with piles on the path that are not on the map, for each seed a new set."""

    def vary(self, seed: int) -> tuple[Mapping[str, Any], Mapping[str, Sequence[Table]]]:
        """Return the changes of `SingleCase.vary`, and the piles."""
        changes, _ = super().vary(seed)
        scenario = load_scenario(self.scenario, dict(changes))
        plan = prepare(scenario)
        path = plan.planner.track
        return changes, {"cylinder": hidden_piles(plan.world, path, (path[0], path[-1]), Random(f"piles/{seed}"))}

    def extra(self, planner: Planner) -> Mapping[str, float]:
        """Return the number of planned paths."""
        return {"plans": float(planner.status.split()[1].rstrip(","))}


def hidden_piles(world: World, path: Sequence[Point], ends: Sequence[Point], random: Random) -> list[Table]:
    """Return PILES piles that are not on the map: three within 0.4 m of `path`, the others within 4 m.

    The vehicle can pass each of them. Raises ConfigError if there is no room.
    """
    piles: list[Table] = []
    for _ in range(10_000):
        if len(piles) == PILES:
            return piles
        place, radius = _random_point_near(path, 0.4 if len(piles) < 3 else 4.0, random), random.uniform(*PILE_RADIUS_M)
        gap = min([world.clearance(*place), *(dist(place, (p["north"], p["east"])) - p["radius"] for p in piles)])
        if gap - radius >= GAP_M and all(dist(place, end) > radius + CLEAR_M for end in ends):
            piles.append({"north": place[0], "east": place[1], "radius": radius, "hidden": True})
    raise ConfigError(f"{world.name} has no room for {PILES} piles beside the path: use a world with fewer obstacles")


def _random_point_near(path: Sequence[Point], most: float, random: Random) -> Point:
    """Return a random point up to `most` m from the path; a leg's probability is proportional to its length."""
    legs = list(pairwise(path))
    (a, b), *_ = random.choices(legs, [dist(*leg) for leg in legs])
    share, away, bearing = random.random(), random.uniform(0.0, most), random.uniform(-pi, pi)
    return (
        a[0] + share * (b[0] - a[0]) + away * cos(bearing),
        a[1] + share * (b[1] - a[1]) + away * sin(bearing),
    )
