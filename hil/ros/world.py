"""A world as ROS 2 messages: its map and its obstacles, in the frame "map" (ENU).

Of ours nobody reads the obstacles and the description: they are decoded by their definitions alone.
"""

from math import cos, sin
from typing import Any, NamedTuple

from hil.ros.cdr import MalformedError, tolerant
from hil.ros.encoders import Decoder, Encoder
from hil.ros.message import Message, encode, header, read
from hil.ros.topics import TOPICS
from sim.environment.mesh import MeshObstacle
from sim.environment.obstacles import Box, Cylinder
from sim.environment.world import World

FRAME = "map"
OBSTACLES = "obstacles"  # the namespace of the markers
_CUBE, _CYLINDER, _TRIANGLE_LIST = 1, 3, 11  # constants of visualization_msgs/Marker
_COLOUR = {"r": 0.4, "g": 0.45, "b": 0.55, "a": 0.8}
_LEAST_HEIGHT = 0.01  # m: a marker without height is not drawn


class GridMap(NamedTuple):
    """Square cells of `resolution` m, each free or occupied.

    `cells` are 0 (free) and 1 (occupied), row after row from the south, each from the west. `south` and `west` are
    where the first begins (m from the world's origin), `columns` the cells in a row.
    """

    cells: bytes
    columns: int
    resolution: float
    south: float
    west: float


def encode_map(time_ns: int, grid: GridMap) -> bytes:
    """nav_msgs/OccupancyGrid: 0 free, 100 occupied; x is east, y north."""
    head = header(time_ns, FRAME)
    origin = {"position": {"x": grid.west, "y": grid.south}, "orientation": {"w": 1.0}}
    size = {"width": grid.columns, "height": len(grid.cells) // grid.columns, "resolution": grid.resolution}
    info = {"map_load_time": head["stamp"], "origin": origin, **size}
    data = grid.cells.translate(bytes([0, 100, *[100] * 254]))
    return encode("nav_msgs/msg/OccupancyGrid", {"header": head, "info": info, "data": data})


@tolerant
def decode_map(data: bytes) -> GridMap:
    """Return the map; what is not known to be free is occupied. Turned maps are none of ours."""
    message = read("nav_msgs/msg/OccupancyGrid", data)
    info, place = message["info"], message["info"]["origin"]["position"]
    if len(message["data"]) != info["width"] * info["height"] or not info["width"]:
        raise MalformedError("not a map of its size")
    cells = bytes([value != 0 for value in message["data"]])
    return GridMap(cells, info["width"], info["resolution"], place["y"], place["x"])


def encode_obstacles(time_ns: int, world: World) -> bytes:
    """visualization_msgs/MarkerArray: a cylinder, a cube or triangles for each obstacle that is not hidden."""
    placed: tuple[Cylinder | Box, ...] = (*world.cylinder, *world.box)
    seen = [obstacle for obstacle in placed if not obstacle.hidden]
    markers = [_marker(time_ns, number, obstacle, world) for number, obstacle in enumerate(seen)]
    meshes = [mesh for mesh in world.mesh if not mesh.hidden]
    markers += [_mesh_marker(time_ns, number, mesh) for number, mesh in enumerate(meshes, len(seen))]
    return encode("visualization_msgs/msg/MarkerArray", {"markers": markers})


def _marker(time_ns: int, number: int, obstacle: Cylinder | Box, world: World) -> Message:
    bottom = world.foot(obstacle, obstacle.north, obstacle.east)
    height = max(bottom - obstacle.top, _LEAST_HEIGHT)
    if isinstance(obstacle, Cylinder):
        kind, across, along, yaw = _CYLINDER, 2.0 * obstacle.radius, 2.0 * obstacle.radius, 0.0
    else:
        kind, across, along, yaw = _CUBE, obstacle.size_east, obstacle.size_north, -obstacle.heading
    turn = {"x": 0.0, "y": 0.0, "z": sin(0.5 * yaw), "w": cos(0.5 * yaw)}
    marker: dict[str, Any] = {
        "header": header(time_ns, FRAME), "ns": OBSTACLES, "id": number, "type": kind, "color": _COLOUR,
        "scale": {"x": across, "y": along, "z": height}, "text": obstacle.label,
        "pose": {
            "position": {"x": obstacle.east, "y": obstacle.north, "z": 0.5 * height - bottom}, "orientation": turn
        },
    }  # fmt: skip
    return marker


def _mesh_marker(time_ns: int, number: int, mesh: MeshObstacle) -> Message:
    """Return a list of triangles, in the axes of the map."""
    points = [{"x": east, "y": north, "z": -down} for triangle in mesh.placed for north, east, down in triangle]
    return {
        "header": header(time_ns, FRAME), "ns": OBSTACLES, "id": number, "type": _TRIANGLE_LIST, "color": _COLOUR,
        "scale": {"x": 1.0, "y": 1.0, "z": 1.0}, "text": mesh.label, "points": points,
        "pose": {"position": {"x": 0.0, "y": 0.0, "z": 0.0}, "orientation": {"w": 1.0}},
    }  # fmt: skip


def _reader(type_name: str) -> Decoder:
    return tolerant(lambda data: read(type_name, data))


ENCODERS: dict[str, Encoder] = {}  # no sensor sends them
DECODERS: dict[str, Decoder] = {
    name: _reader(TOPICS[name].type) for name in ("robot_description", "obstacles", "/parameter_events")
} | {"map": decode_map}
