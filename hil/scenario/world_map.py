"""Make the occupancy grid, at the vehicle's depth, that a planner has before the dive."""

from collections.abc import Iterable, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.autonomy.paths.curves import Position
from hil.autonomy.paths.occupancy import Extent, OccupancyGrid, Point, depths_near
from hil.autonomy.paths.polygons import fill
from hil.common.errors import ConfigError
from hil.scenario.map_parts import MapPart, map_parts
from hil.scenario.records import Master, Start
from sim.environment.mesh import MeshObstacle, Triangle
from sim.environment.obstacles import Box, Cylinder, Obstacle
from sim.environment.terrain import NO_DATA
from sim.environment.things.pipelines import Pipeline
from sim.environment.world import World
from sim.vehicle.vehicle import Vehicle

Array = NDArray[np.float64]
Layer = tuple[Any, Any]  # highest and lowest depth (m) in each cell that the vehicle needs free

_HALF_DIAGONAL = 0.7072  # cells; distance from the centre of a cell to its corner


def parts_of(world: World, master: Master, start: Start, points: Sequence[Point] = ()) -> list[MapPart]:
    """Return the parts of the world that the map may show, in growing order: from the area of start and goal to all.

    `points` are further positions (north, east) of the planner's task.
    """
    wanted = [(start.north, start.east), *(place[:2] for place in master.places()), *points]
    return map_parts(_extent(world), master.resolution, wanted)


def known_map(
    master: Master,
    vehicle: Vehicle,
    world: World,
    map_part: MapPart | None = None,
    course: Sequence[Position] = (),
) -> OccupancyGrid:
    """Return the map that the scenario's `map` names: of the world, empty, or from a file. Raises ConfigError.

    It shows `map_part` of the world with that part's cell size; by default all, with the scenario's. Obstacles with
    `hidden` are not on it. The vehicle is at the depth of the nearest place of `course` (m, NED), by default of the
    way through the scenario's waypoints to its goal.
    """
    course = course or master.places() or [(0.0, 0.0, master.depth)]
    below = 0.5 * vehicle.dimensions[2] + master.seabed_margin
    map_part = map_part or MapPart(_extent(world), master.resolution)
    if master.map == "unknown":
        return OccupancyGrid.empty(*map_part)
    if master.map != "known":
        return OccupancyGrid.read(master.map)
    visible_world = world._replace(
        cylinder=tuple(o for o in world.cylinder if not o.hidden),
        box=tuple(o for o in world.box if not o.hidden),
        mesh=tuple(o for o in world.mesh if not o.hidden),
        pipeline=tuple(o for o in world.pipeline if not o.hidden),
    )
    deepest = max(depth for _, _, depth in course)
    if world.terrain is None and deepest + below >= world.depth:
        raise ConfigError(
            f"master: depth: at {deepest:g} m the vehicle has not its {below:.2f} m of water above the seabed of "
            f"{world.name}, which is {world.depth:g} m deep; go higher, or lessen seabed_margin"
        )
    grid = map_at(
        visible_world,
        course,
        below,
        map_part.resolution,
        map_part.extent,
        is_coarse=map_part.resolution > master.resolution,
    )
    for zone in world.all_zones() if master.avoid_zones else ():
        if zone.kind in master.avoid_zones:
            close(grid, zone.outline)
    return grid


def map_at(
    world: World,
    depth: float | Sequence[Position],
    below: float,
    resolution: float,
    extent: Extent | None = None,
    is_coarse: bool = False,
    above: float | None = None,
) -> OccupancyGrid:
    """Return the map of `world`, with cells of `resolution` m, for a vehicle at `depth` m that needs `below` m below.

    `depth` may be a course (m, NED): in each cell the vehicle is at the depth of the nearest place of it. The map shows
    the whole world, or an `extent`. A cell is occupied if an obstacle at its centre reaches into the layer from `depth`
    - `above` (by default `below`) to `depth`, or the seabed there is shallower than `depth` + `below`. An obstacle so
    thin that it may miss all centres is enlarged until it cannot. If `is_coarse`, a cell is occupied if any part of it
    may be. Raises ConfigError.
    """
    seabed = partial(_shallowest, cell=resolution) if is_coarse else _seabed

    def clearance(norths: Array, easts: Array) -> Array:
        free = np.full(norths.shape, np.inf)
        deep = depths_near(depth, norths, easts) if isinstance(depth, Sequence) else depth
        shallowest, lowest = float(np.min(deep)), float(np.max(deep))
        height = below if above is None else above
        highest = shallowest - height
        layer = (deep - height, deep) if shallowest < lowest else None
        for obstacle in world.obstacles():
            if obstacle.top < lowest and obstacle.bottom > highest:
                widen = max(0.0, _HALF_DIAGONAL * resolution - (0.0 if is_coarse else _thickness(obstacle)))
                if isinstance(obstacle, Pipeline):
                    _lower_by_pieces(free, obstacle, world, (highest, lowest), norths, easts, widen, layer)
                elif isinstance(obstacle, MeshObstacle):
                    _lower_by_mesh(free, obstacle.between(highest, lowest), norths, easts, widen, layer)
                else:
                    _lower(free, obstacle, norths, easts, widen, layer)
        is_deep = seabed(world, norths, easts) > deep + below
        if world.terrain is not None:
            world.terrain.unmap()  # the kernel has mapped far more than what was read
        return np.where(is_deep, free, -1.0)

    return OccupancyGrid.rasterise(clearance, extent or _extent(world), resolution)


def _extent(world: World) -> Extent:
    south, north, west, east = world.extent
    return Extent(south, west, north, east)


def _lower(
    free: Array, obstacle: Obstacle, norths: Array, easts: Array, widen: float = 0.0, layer: Layer | None = None
) -> None:
    """Lower `free` (m) to the distance from an obstacle, enlarged by `widen` m, where it is near and in the `layer`.

    `norths` and `easts` are the centres of a map's cells; an obstacle more than two cells away is ignored.
    """
    rows, columns = slice(None), slice(None)
    if isinstance(obstacle, (Cylinder, Box)):
        cell = abs(norths[-1, 0] - norths[0, 0]) / max(1, len(norths) - 1)
        reach = _size(obstacle) + widen + 2.0 * cell
        rows = slice(*np.searchsorted(norths[:, 0], (obstacle.north - reach, obstacle.north + reach)))
        columns = slice(*np.searchsorted(easts[0], (obstacle.east - reach, obstacle.east + reach)))
    distance = _separation(obstacle, norths[rows, columns], easts[rows, columns]) - widen
    part = free[rows, columns]
    np.minimum(part, distance, out=part, where=_reaches(layer, obstacle.top, obstacle.bottom, rows, columns))


def _reaches(layer: Layer | None, top: float, bottom: float, rows: slice, columns: slice) -> Any:
    """Return in which cells of a window something between `top` and `bottom` m is at least partly in the layer."""
    return layer is None or ((top < layer[1][rows, columns]) & (bottom > layer[0][rows, columns]))


def _lower_by_mesh(
    free: Array, triangles: Iterable[Triangle], norths: Array, easts: Array, widen: float, layer: Layer | None,
    thickness: float = 0.0,
) -> None:  # fmt: skip
    """Set `free` to -1 in cells whose centre is within `widen` m of a triangle, seen from above.

    The triangle reaches `thickness` m above and below its corners.
    """
    for triangle in triangles:
        corners = np.array(triangle)[:, :2]
        (south, west), (north, east) = corners.min(axis=0) - widen, corners.max(axis=0) + widen
        rows = slice(*np.searchsorted(norths[:, 0], (south, north)))
        columns = slice(*np.searchsorted(easts[0], (west, east)))
        part = free[rows, columns]
        if part.size and part.max() > -1.0:  # else other triangles have set all of it
            near = _to_triangle(corners, norths[rows, columns], easts[rows, columns]) <= widen
            top, bottom = min(c[2] for c in triangle) - thickness, max(c[2] for c in triangle) + thickness
            part[near & _reaches(layer, top, bottom, rows, columns)] = -1.0


def _lower_by_pieces(
    free: Array, pipeline: Pipeline, world: World, depths: tuple[float, float], norths: Array, easts: Array,
    widen: float, layer: Layer | None,
) -> None:  # fmt: skip
    """Set `free` to -1 along the parts of a pipeline that lie between two `depths`."""
    radius, (south, north), (west, east) = 0.5 * pipeline.diameter, norths[[0, -1], 0], easts[0, [0, -1]]
    middle, size = (0.5 * (south + north), 0.5 * (west + east)), float(np.hypot(north - south, east - west))
    near = pipeline.pieces(world.seabed, world.spacing(), *middle, size)
    level = [
        (one, other, other)
        for one, other in near
        if min(one[2], other[2]) - radius < depths[1] and max(one[2], other[2]) + radius > depths[0]
    ]
    _lower_by_mesh(free, level, norths, easts, radius + widen, layer, radius)


def close(grid: OccupancyGrid, outline: Sequence[Point]) -> None:
    """Occupy the cells of a map whose centres are inside an outline (corners, north and east in m)."""
    corners = np.array([*outline, outline[0]], float)
    norths, easts = (
        first + grid.resolution * (np.arange(count) + 0.5)
        for first, count in zip(grid.origin, grid.cells.shape, strict=True)
    )
    window, inside = fill((corners,), norths, easts)
    grid.cells[window] |= inside


def _to_triangle(corners: Array, north: Array, east: Array) -> Array:
    """Return the distances (m) of positions from a triangle (3 x 2, m); 0 inside it."""
    least, turns = np.full(north.shape, np.inf), []
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        (x, y), at_x, at_y = end - start, north - start[0], east - start[1]
        square = x * x + y * y
        share = np.clip((at_x * x + at_y * y) / square, 0.0, 1.0) if square else 0.0
        least = np.minimum(least, np.hypot(at_x - share * x, at_y - share * y))
        turns.append(x * at_y - y * at_x)
    inside = (np.minimum.reduce(turns) > 0.0) | (np.maximum.reduce(turns) < 0.0)
    return np.where(inside, 0.0, least)


def _size(obstacle: Cylinder | Box) -> float:
    """Return the radius (m) of the circle around the obstacle's centre that contains it."""
    if isinstance(obstacle, Cylinder):
        return obstacle.radius
    return 0.5 * float(np.hypot(obstacle.size_north, obstacle.size_east))


def _thickness(obstacle: Obstacle) -> float:
    """Return the radius (m) of the largest circle inside the obstacle."""
    if isinstance(obstacle, Cylinder):
        return obstacle.radius
    if isinstance(obstacle, Pipeline):
        return 0.5 * obstacle.diameter
    if isinstance(obstacle, MeshObstacle):
        return 0.0
    return 0.5 * min(obstacle.size_north, obstacle.size_east) if isinstance(obstacle, Box) else np.inf


def _separation(obstacle: Obstacle, north: Array, east: Array) -> Array:
    """Return the obstacle's `separation` (m) at arrays of positions."""
    if isinstance(obstacle, Cylinder):
        return np.asarray(np.hypot(north - obstacle.north, east - obstacle.east) - obstacle.radius)
    if isinstance(obstacle, Box):
        c, s = np.cos(obstacle.heading), np.sin(obstacle.heading)
        x, y = north - obstacle.north, east - obstacle.east
        along = np.abs(c * x + s * y) - 0.5 * obstacle.size_north
        across = np.abs(c * y - s * x) - 0.5 * obstacle.size_east
        outside = np.hypot(np.maximum(along, 0.0), np.maximum(across, 0.0))
        return np.asarray(outside + np.minimum(np.maximum(along, across), 0.0))
    linear: Any = obstacle.separation  # a wall's, which also works with arrays
    return np.asarray(linear(north, east)[0])


def _seabed(world: World, north: Array, east: Array) -> Any:
    """Return the depth of the seabed (m) at arrays of positions, with the same result as `World.seabed`."""
    terrain = world.terrain
    if terrain is None:
        return world.depth
    rows, columns = terrain.grid.rows, terrain.grid.columns
    nodes = np.asarray(terrain.depths, np.float32).reshape(rows, columns)  # may be a mapped file, read only in part
    x, y = (north - terrain.grid.north_min) * terrain.scale, (east - terrain.grid.east_min) * terrain.scale
    on_grid = (x >= 0.0) & (x <= rows - 1) & (y >= 0.0) & (y <= columns - 1)
    i, j = (np.clip(np.asarray(v, np.intp), 0, count - 2) for v, count in ((x, rows), (y, columns)))
    u, v = x - i, y - j
    a, b, c, d = (nodes[i + k, j + m].astype(np.float64) for k, m in ((0, 0), (0, 1), (1, 0), (1, 1)))
    depth = a + (c - a) * u + (b - a) * v + (a - b - c + d) * u * v
    return np.where(on_grid, np.where(np.isnan(depth), NO_DATA, depth), terrain.outside)


def _shallowest(world: World, north: Array, east: Array, cell: float) -> Any:
    """Return a lower bound of the seabed's depth (m) in each cell of `cell` m, from their centres.

    The seabed in a cell is nowhere above the highest of the nodes in it and next to it.
    """
    terrain = world.terrain
    if terrain is None:
        return world.depth
    grid, half = terrain.grid, 0.5 * cell
    nodes = np.asarray(terrain.depths, np.float32).reshape(grid.rows, grid.columns)
    spans, is_inside = [], []
    for middles, first, count in ((north[:, 0], grid.north_min, grid.rows), (east[0], grid.east_min, grid.columns)):
        low, high = (np.floor((middles + side - first) * terrain.scale).astype(np.intp) for side in (-half, half))
        is_inside.append((low >= 0) & (high + 1 < count))
        spans.append((np.clip(low, 0, count - 1), np.clip(high + 1, 0, count - 1)))
    (top, bottom), (left, right) = spans
    ends = np.column_stack([left, right + 1]).ravel() - left[0]
    least = np.empty(north.shape)
    for row, (here, there) in enumerate(zip(top, bottom, strict=True)):
        line = nodes[here : there + 1, left[0] : right[-1] + 1].min(axis=0)  # nan if one of them is nan
        line = np.append(np.where(np.isnan(line), NO_DATA, line), np.inf)  # because a span may end with the grid
        least[row] = np.minimum.reduceat(line, ends)[::2]
    is_whole = is_inside[0][:, None] & is_inside[1]
    return np.where(is_whole, least, np.minimum(least, terrain.outside))
