"""A fleet in the scene: which vehicles are in range of each other, and their target positions in the formation."""

from collections.abc import Mapping
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from hil.autonomy.fleets.hunting import HuntPlan
from hil.view.scene import colours
from hil.view.scene.frames import to_scene
from hil.view.scene.world import WorldScene

PATH_POINTS = 60  # points in the path of a target position
PLACE_SIZE = 0.25  # m


class Hunt(NamedTuple):
    """A hunt that is shown: its members in order, their plan, the range of their reports (m), and the depth (m)."""

    nodes: tuple[str, ...]
    plan: HuntPlan
    reach: float
    depth: float


class FleetScene:
    """Links and target positions of a hunt. `server` is a viser.ViserServer."""

    def __init__(self, server: Any, hunt: Hunt, world: WorldScene) -> None:
        self._scene, self._hunt = server.scene, hunt
        self._links: Any = None
        target = to_scene([(*hunt.plan.target, hunt.depth)])[0]
        self._scene.add_icosphere("/target", 0.35, colours.GOAL, position=target)
        self._scene.add_label("/target/name", "target", position=(0.0, 0.0, 0.6))
        for number, node in enumerate(hunt.nodes):
            clocks = np.linspace(0.0, hunt.plan.duration, PATH_POINTS)
            path = [hunt.plan.position_at(number, float(clock)) for clock in clocks]
            world.draw_path(path, hunt.depth, f"path/{node}")

    def draw(self, latest: Mapping[str, Mapping[str, Any]], positions: Mapping[str, Any]) -> None:
        """Draw links and target positions, from each vehicle's newest samples and its `positions` in the scene (m).

        Two vehicles are linked if they are within range. A target position is for the plan's clock that the vehicle
        itself reports.
        """
        pairs = [
            (positions[a], positions[b])
            for a, b in combinations([node for node in self._hunt.nodes if node in positions], 2)
            if np.linalg.norm((positions[a] - positions[b])[:2]) < self._hunt.reach
        ]
        if pairs:
            segments = np.array(pairs, np.float32)
            self._links = self._scene.add_line_segments(
                "/fleet/links", segments, colours.LINK, thickness=2.0, thickness_units="screen"
            )
        elif self._links is not None:
            self._links.remove()
            self._links = None
        plan = self._hunt.plan
        clocks = {
            number: latest[node]["formation"].clock_ns * 1e-9
            for number, node in enumerate(self._hunt.nodes)
            if "formation" in latest.get(node, {})
        }
        if clocks:
            wanted = [(*plan.position_at(number, clock), self._hunt.depth) for number, clock in clocks.items()]
            self._scene.add_point_cloud(
                "/fleet/places", to_scene(wanted), colours.PLACE, point_size=PLACE_SIZE, point_shape="circle"
            )
