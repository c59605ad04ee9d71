"""The world in the scene: seabed, obstacles, meshes, pipelines, zones and current."""

from math import ceil
from typing import Any

import numpy as np

from hil.view.scene.water import bottom_content
from sim.environment.obstacles import Box, Cylinder
from sim.environment.world import World

MAX_NODES = 400  # per side of the drawn seabed: 320,000 triangles, which a browser can still rotate without a GPU
TOP = -1.0  # depth (m) at which obstacles end in the picture; their tops are above the water


def triangles(norths: Any, easts: Any, depths: Any) -> tuple[Any, Any]:
    """Return the nodes of the seabed (n x 3, NED, m), and the triangles without unknown depths (m x 3 node indices)."""
    rows, columns = depths.shape
    points = np.stack(np.broadcast_arrays(norths[:, None], easts[None, :], depths), axis=2).reshape(-1, 3)
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    faces = np.concatenate([np.stack(corners, axis=2).reshape(-1, 3) for corners in ((a, b, d), (a, d, c))])
    faces = faces[np.isfinite(points[faces, 2]).all(axis=1)]
    return np.nan_to_num(points), faces


def nodes(world: World, most: int = MAX_NODES) -> tuple[Any, Any, Any]:
    """Return norths, easts and depths (rows x columns, m) of the seabed, thinned out to `most` nodes per side."""
    if world.terrain is None:
        south, north, west, east = world.extent
        return np.array([south, north]), np.array([west, east]), np.full((2, 2), world.depth)
    grid = world.terrain.grid
    stride = max(1, ceil(max(grid.rows, grid.columns) / most))
    mapped = np.asarray(world.terrain.depths).reshape(grid.rows, grid.columns)  # may be mapped from a file
    depths = mapped[::stride, ::stride].astype(float)
    norths = grid.north_min + grid.resolution * np.arange(0, grid.rows, stride)
    easts = grid.east_min + grid.resolution * np.arange(0, grid.columns, stride)
    return norths, easts, depths


def world_content(world: World) -> tuple[dict[str, Any], Any, Any]:
    """Return what does not move: as words and numbers, the depths (m, float32), and S-57's materials of the nodes."""
    norths, easts, depths = nodes(world)
    codes = np.zeros(depths.shape, np.uint8)
    if world.bottom_map:
        codes = world.bottom_map.codes(*np.meshgrid(norths, easts, indexing="ij"))
    placed: tuple[Cylinder | Box, ...] = (*world.cylinder, *world.box)
    header = {
        "name": world.name, "extent": world.extent, "rows": len(norths), "columns": len(easts),
        "norths": (norths[0], norths[-1]), "easts": (easts[0], easts[-1]),
        "least": float(np.nanmin(depths)), "deepest": float(np.nanmax(depths)),
        "bottom": bottom_content(world.bottom), "current": world.current,
        "obstacles": [_obstacle(world, each) for each in placed],
        "meshes": [
            {"triangles": list(mesh.placed), "colour": mesh.keys.colour, "net": bool(mesh.net)}
            for mesh in world.as_seen().mesh
        ],
        "pipelines": [
            {"pieces": list(each.drawn(world.seabed, world.spacing())), "diameter": each.diameter,
             "colour": each.colour, "name": each.label}
            for each in world.pipeline
        ],
        "zones": [{"outline": each.outline, "name": each.label} for each in world.all_zones()],
    }  # fmt: skip
    return header, depths.astype(np.float32), codes


def _obstacle(world: World, obstacle: Cylinder | Box) -> dict[str, Any]:
    """Return an obstacle from its foot to its top, which is cut off above the water."""
    bottom = world.foot(obstacle, obstacle.north, obstacle.east)
    top = max(obstacle.top, TOP)
    place = {"north": obstacle.north, "east": obstacle.east, "top": top, "bottom": max(bottom, top + 0.1)}
    if isinstance(obstacle, Cylinder):
        return place | {"radius": obstacle.radius}
    return place | {"size": (obstacle.size_north, obstacle.size_east), "heading": obstacle.heading}
