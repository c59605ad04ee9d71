"""Scene for Foxglove's 3-D panel: world and vehicles of a scenario.

They are a foxglove.SceneUpdate, made by Foxglove's SDK; axes are those of ROS (ENU, FLU).
"""

from base64 import b64encode
from math import cos, sin
from typing import Any

from hil.common.errors import MissingExtraError
from hil.gateways.foxglove.protocol import Channel
from hil.scenario.config import Scenario
from sim.environment.mesh import MeshObstacle
from sim.environment.obstacles import Cylinder
from sim.environment.things.pipelines import Pipeline
from sim.environment.things.zones import Zone
from sim.environment.world import World
from sim.vehicle.vehicle import Vehicle

SCENE_TOPIC = "/scene"
MAX_NODES = 150  # a side of the seabed that is sent: 45,000 triangles
MAP = "map"
GROUND, HULL = (0.55, 0.5, 0.4, 1.0), (0.98, 0.8, 0.08, 1.0)  # red, green, blue, opacity
THRUSTER, OBSTACLE = (0.12, 0.16, 0.23, 1.0), (0.4, 0.45, 0.55, 0.6)
ZONE, ZONE_WIDTH = (0.75, 0.1, 0.6, 0.9), 1.0  # magenta, as on charts; m
THRUSTER_SIZE = 0.1, 0.1, 0.1  # m


def scene_channel() -> Channel:
    """Return the channel of world and vehicles. Raises MissingExtraError."""
    schema = _messages().SceneUpdate.get_schema()
    return Channel(SCENE_TOPIC, schema.name, "protobuf", b64encode(schema.data).decode(), schema.encoding)


def encode_scene(scenario: Scenario, world: World, vehicle: Vehicle) -> bytes:
    """Return the world in the frame "map" and the vehicle in its "base_link". Raises MissingExtraError."""
    m = _messages()
    obstacles = [_obstacle(m, obstacle, world) for obstacle in (*world.cylinder, *world.box)]
    placed = m.SceneEntity(
        frame_id=MAP, id="world", triangles=[_seabed(m, world), *(_mesh(m, mesh) for mesh in world.as_seen().mesh)],
        lines=[*(_pipeline(m, one, world) for one in world.pipeline), *(_zone(m, one) for one in world.all_zones())],
        cylinders=[one for one in obstacles if isinstance(one, m.CylinderPrimitive)],
        cubes=[one for one in obstacles if isinstance(one, m.CubePrimitive)],
    )  # fmt: skip
    length, width, height = vehicle.dimensions
    cubes = [_cube(m, (0.0, 0.0, 0.0), (length, width, height), HULL)]
    for thruster in vehicle.thrusters:
        x, y, z = thruster.position
        cubes.append(_cube(m, (x, -y, -z), THRUSTER_SIZE, THRUSTER))
    frame = f"{scenario.ros.frame_prefix}base_link"
    hull = m.SceneEntity(frame_id=frame, id="vehicle", frame_locked=True, cubes=cubes)
    return bytes(m.SceneUpdate(entities=[placed, hull]).encode())


def _obstacle(m: Any, obstacle: Any, world: World) -> Any:
    bottom = world.foot(obstacle, obstacle.north, obstacle.east)
    height = max(bottom - obstacle.top, 0.1)
    middle = obstacle.east, obstacle.north, -(bottom - 0.5 * height)
    if isinstance(obstacle, Cylinder):
        size = m.Vector3(x=2.0 * obstacle.radius, y=2.0 * obstacle.radius, z=height)
        return m.CylinderPrimitive(
            pose=_pose(m, middle), size=size, bottom_scale=1.0, top_scale=1.0, color=m.Color(**_rgba(OBSTACLE))
        )
    size = obstacle.size_east, obstacle.size_north, height
    return _cube(m, middle, size, OBSTACLE, -obstacle.heading)


def _seabed(m: Any, world: World) -> Any:
    from hil.view.scene.world import nodes, triangles

    norths, easts, depths = nodes(world, MAX_NODES)
    places, faces = triangles(norths, easts, depths)
    return m.TriangleListPrimitive(
        pose=_pose(m, (0.0, 0.0, 0.0)), color=m.Color(**_rgba(GROUND)), indices=faces.ravel().tolist(),
        points=[m.Point3(x=float(east), y=float(north), z=-float(depth)) for north, east, depth in places],
    )  # fmt: skip


def _mesh(m: Any, mesh: MeshObstacle) -> Any:
    red, green, blue, opacity = (*mesh.keys.colour, 1.0) if mesh.keys.colour else OBSTACLE
    colour = red, green, blue, OBSTACLE[3] if mesh.net else opacity
    corners = [*mesh.corners()]
    return m.TriangleListPrimitive(
        pose=_pose(m, (0.0, 0.0, 0.0)), color=m.Color(**_rgba(colour)), indices=list(range(len(corners))),
        points=_points(m, corners),
    )  # fmt: skip


def _pipeline(m: Any, pipeline: Pipeline, world: World) -> Any:
    ends = [end for piece in pipeline.drawn(world.seabed, world.spacing()) for end in piece]
    return _line(m, m.LinePrimitiveLineType.LineList, ends, pipeline.diameter, (*pipeline.colour, 1.0))


def _zone(m: Any, zone: Zone) -> Any:
    corners = [(north, east, 0.0) for north, east in zone.outline]
    return _line(m, m.LinePrimitiveLineType.LineLoop, corners, ZONE_WIDTH, ZONE)


def _line(m: Any, kind: Any, points: Any, width: float, colour: Any) -> Any:
    """Return a line through places (NED, m), `width` m wide."""
    return m.LinePrimitive(
        type=kind, pose=_pose(m, (0.0, 0.0, 0.0)), thickness=width, scale_invariant=False, points=_points(m, points),
        color=m.Color(**_rgba(colour)),
    )  # fmt: skip


def _points(m: Any, points: Any) -> Any:
    return [m.Point3(x=east, y=north, z=-down) for north, east, down in points]


def _cube(m: Any, middle: Any, size: Any, colour: Any, yaw: float = 0.0) -> Any:
    x, y, z = size
    return m.CubePrimitive(pose=_pose(m, middle, yaw), size=m.Vector3(x=x, y=y, z=z), color=m.Color(**_rgba(colour)))


def _pose(m: Any, position: Any, yaw: float = 0.0) -> Any:
    x, y, z = (float(value) for value in position)
    turn = m.Quaternion(x=0.0, y=0.0, z=sin(0.5 * yaw), w=cos(0.5 * yaw))
    return m.Pose(position=m.Vector3(x=x, y=y, z=z), orientation=turn)


def _rgba(colour: Any) -> dict[str, float]:
    return dict(zip("rgba", colour, strict=True))


def _messages() -> Any:
    try:
        from foxglove import messages
    except ImportError:
        raise MissingExtraError("Foxglove's scene needs foxglove-sdk: pip install 'uuv-hil[foxglove]'") from None
    return messages
