"""A world as ROS 2 messages: its map and its obstacles, in the frame "map" (ENU).

Obstacles and the vehicle's description are only sent, so they have no decoders other than by their definitions.
"""

from collections.abc import Sequence
from math import cos, sin
from typing import Any, NamedTuple

from hil.common.vectors import Vector3
from hil.ros.cdr import MalformedError, tolerant
from hil.ros.encoders import Decoder
from hil.ros.message import Message, encode, header, read
from hil.ros.topics import TOPICS
from sim.environment.mesh import MeshObstacle
from sim.environment.obstacles import Box, Cylinder
from sim.environment.things.pipelines import Pipeline
from sim.environment.things.zones import Zone
from sim.environment.world import World

FRAME = "map"
OBSTACLES = "obstacles"  # namespace of the markers
PIPELINES, ZONES = "pipelines", "zones"
_CUBE, _CYLINDER, _LINE_STRIP, _LINE_LIST, _TRIANGLE_LIST = 1, 3, 4, 5, 11  # constants of visualization_msgs/Marker
_COLOUR = {"r": 0.4, "g": 0.45, "b": 0.55, "a": 0.8}
_ZONE_COLOUR = {"r": 0.75, "g": 0.1, "b": 0.6, "a": 0.9}  # magenta, as on charts
_ZONE_WIDTH = 1.0  # m
_MIN_HEIGHT = 0.01  # m; a marker without height is not drawn


class GridMap(NamedTuple):
    """Square cells of `resolution` m, each free or occupied.

    `cells` are 0 (free) and 1 (occupied), row by row from the south, each row from the west. `south` and `west` are the
    corner of the first cell (m from the world's origin); `columns` is the number of cells in a row.
    """

    cells: bytes
    columns: int
    resolution: float
    south: float
    west: float


def encode_map(time_ns: int, grid: GridMap) -> bytes:
    """Encode nav_msgs/OccupancyGrid: 0 free, 100 occupied; x is east, y north."""
    head = header(time_ns, FRAME)
    origin = {"position": {"x": grid.west, "y": grid.south}, "orientation": {"w": 1.0}}
    size = {"width": grid.columns, "height": len(grid.cells) // grid.columns, "resolution": grid.resolution}
    info = {"map_load_time": head["stamp"], "origin": origin, **size}
    data = grid.cells.translate(bytes([0, 100, *[100] * 254]))
    return encode("nav_msgs/msg/OccupancyGrid", {"header": head, "info": info, "data": data})


@tolerant
def decode_map(data: bytes) -> GridMap:
    """Return the map; cells that are not known to be free are occupied. Rotated maps are not supported."""
    message = read("nav_msgs/msg/OccupancyGrid", data)
    info, position = message["info"], message["info"]["origin"]["position"]
    if len(message["data"]) != info["width"] * info["height"] or not info["width"]:
        raise MalformedError("not a map of its size")
    cells = bytes([value != 0 for value in message["data"]])
    return GridMap(cells, info["width"], info["resolution"], position["y"], position["x"])


def encode_obstacles(time_ns: int, world: World) -> bytes:
    """Encode visualization_msgs/MarkerArray of everything not hidden: cylinders, cubes, triangles; pipelines; zones.

    Raises ConfigError for a file of zones that cannot be read.
    """
    placed: tuple[Cylinder | Box, ...] = (*world.cylinder, *world.box)
    seen = [obstacle for obstacle in placed if not obstacle.hidden]
    markers = [_marker(time_ns, number, obstacle, world) for number, obstacle in enumerate(seen)]
    meshes = [mesh for mesh in world.mesh if not mesh.hidden]
    markers += [_mesh_marker(time_ns, number, mesh) for number, mesh in enumerate(meshes, len(seen))]
    pipelines = [pipeline for pipeline in world.pipeline if not pipeline.hidden]
    markers += [_pipeline_marker(time_ns, number, pipeline, world) for number, pipeline in enumerate(pipelines)]
    markers += [_zone_marker(time_ns, number, zone) for number, zone in enumerate(world.all_zones())]
    return encode("visualization_msgs/msg/MarkerArray", {"markers": markers})


def _marker(time_ns: int, number: int, obstacle: Cylinder | Box, world: World) -> Message:
    bottom = world.foot(obstacle, obstacle.north, obstacle.east)
    height = max(bottom - obstacle.top, _MIN_HEIGHT)
    if isinstance(obstacle, Cylinder):
        kind, across, along, yaw = _CYLINDER, 2.0 * obstacle.radius, 2.0 * obstacle.radius, 0.0
    else:
        kind, across, along, yaw = _CUBE, obstacle.size_east, obstacle.size_north, -obstacle.heading
    attitude = {"x": 0.0, "y": 0.0, "z": sin(0.5 * yaw), "w": cos(0.5 * yaw)}
    marker: dict[str, Any] = {
        "header": header(time_ns, FRAME), "ns": OBSTACLES, "id": number, "type": kind, "color": _COLOUR,
        "scale": {"x": across, "y": along, "z": height}, "text": obstacle.label,
        "pose": {
            "position": {"x": obstacle.east, "y": obstacle.north, "z": 0.5 * height - bottom}, "orientation": attitude
        },
    }  # fmt: skip
    return marker


def _mesh_marker(time_ns: int, number: int, mesh: MeshObstacle) -> Message:
    """Return a list of triangles, along the axes of the map."""
    colour = dict(zip("rgba", (*mesh.keys.colour, _COLOUR["a"]), strict=True)) if mesh.keys.colour else _COLOUR
    corners = [*mesh.corners()]
    return _drawn(time_ns, OBSTACLES, number, _TRIANGLE_LIST, corners, 1.0, colour, mesh.label)


def _pipeline_marker(time_ns: int, number: int, pipeline: Pipeline, world: World) -> Message:
    ends = [end for piece in pipeline.drawn(world.seabed, world.spacing()) for end in piece]
    colour = dict(zip("rgba", (*pipeline.colour, 1.0), strict=True))
    return _drawn(time_ns, PIPELINES, number, _LINE_LIST, ends, pipeline.diameter, colour, pipeline.label)


def _zone_marker(time_ns: int, number: int, zone: Zone) -> Message:
    corners = [(north, east, 0.0) for north, east in (*zone.outline, zone.outline[0])]
    return _drawn(time_ns, ZONES, number, _LINE_STRIP, corners, _ZONE_WIDTH, _ZONE_COLOUR, zone.label)


def _drawn(
    time_ns: int, space: str, number: int, kind: int, points: Sequence[Vector3], size: float,
    colour: dict[str, float], text: str,
) -> Message:  # fmt: skip
    """Return a marker of positions (NED, m); lines are `size` m wide."""
    return {
        "header": header(time_ns, FRAME), "ns": space, "id": number, "type": kind, "color": colour, "text": text,
        "scale": {"x": size, "y": 1.0, "z": 1.0},
        "points": [{"x": east, "y": north, "z": -down} for north, east, down in points],
        "pose": {"position": {"x": 0.0, "y": 0.0, "z": 0.0}, "orientation": {"w": 1.0}},
    }  # fmt: skip


def _reader(type_name: str) -> Decoder:
    return tolerant(lambda data: read(type_name, data))


DECODERS: dict[str, Decoder] = {
    name: _reader(TOPICS[name].type) for name in ("robot_description", "obstacles", "/parameter_events", "/rosout")
} | {"map": decode_map}
