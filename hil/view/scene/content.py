"""The content of a scene, encoded once for all browsers."""

import zlib
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from hil.autonomy.fleets.hunting import HuntPlan
from hil.view.feed import pack
from hil.view.scene.vehicle import sensor_content, vehicle_content
from hil.view.scene.water import water_content
from hil.view.scene.world import world_content
from sim.environment.world import World
from sim.sensors.sensor_set import SensorSet
from sim.vehicle.vehicle import Vehicle

UNKNOWN_DEPTH = 65535  # of a node of the seabed
HUNT_POINTS = 60  # in the path of a place in the formation


class Hunt(NamedTuple):
    """A hunt that is shown: its members in order, their plan, the range of their reports (m), and the depth (m)."""

    nodes: tuple[str, ...]
    plan: HuntPlan
    reach: float
    depth: float


class SceneContent(NamedTuple):
    """Data of a run from its scenario; without a scenario the fields are None or empty."""

    world: World | None = None
    vehicles: Mapping[str, Vehicle] = {}
    path: Sequence[Sequence[float]] = ()
    depth: float = 0.0
    goal: tuple[float, float] | None = None
    sensors: SensorSet = MappingProxyType({})  # of each vehicle
    hunt: Hunt | None = None


def encode_content(content: SceneContent) -> bytes:
    """Return the content as the page reads it, gzipped: words and numbers, depths as 16 bits a node, materials."""
    shapes = {name: vehicle_content(file) for name, file in content.vehicles.items()}
    header: dict[str, Any] = {
        "vehicles": shapes, "sensors": sensor_content(content.sensors), "water": water_content(content.sensors),
        "path": with_depth(content.path, content.depth), "depth": content.depth, "world": None,
        "goal": (*content.goal, content.depth) if content.goal else None,
    }  # fmt: skip
    if content.hunt:
        header["hunt"] = _hunt(content.hunt)
    data = b""
    if content.world:
        header["world"], depths, codes = world_content(content.world)
        least, span = header["world"]["least"], header["world"]["deepest"] - header["world"]["least"]
        steps = (depths - least) * ((UNKNOWN_DEPTH - 1) / max(span, 1e-6))
        data = np.where(np.isfinite(depths), np.nan_to_num(steps), UNKNOWN_DEPTH).astype("<u2").tobytes()
        data += codes.astype(np.uint8).tobytes()
    deflate = zlib.compressobj(6, zlib.DEFLATED, zlib.MAX_WBITS | 16)
    return deflate.compress(pack(header, data)) + deflate.flush()


def with_depth(path: Sequence[Sequence[float]], depth: float) -> list[tuple[float, float, float]]:
    """Return points (NED, m); those without a depth are at `depth`."""
    return [(point[0], point[1], point[2] if len(point) > 2 else depth) for point in path]


def _hunt(hunt: Hunt) -> dict[str, Any]:
    clocks = np.linspace(0.0, hunt.plan.duration, HUNT_POINTS)
    paths = {
        node: with_depth([hunt.plan.position_at(number, float(clock)) for clock in clocks], hunt.depth)
        for number, node in enumerate(hunt.nodes)
    }
    return {"target": (*hunt.plan.target, hunt.depth), "reach": hunt.reach, "paths": paths}
