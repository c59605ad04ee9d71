"""Worlds read from TOML: water, seabed and obstacles."""

import os
import sys
from math import inf, pi
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from hil.common.errors import ConfigError
from hil.common.schema import Range, Reader, find_preset, parse, reader_of
from hil.common.tables import LARGEST, check_file, read_cached, read_table, write_cached
from sim.environment.bottom import Bottom
from sim.environment.obstacles import Box, Cylinder, Obstacle, Wall

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from hil.common.tables import Stamp
    from sim.environment.mesh import MeshObstacle
    from sim.environment.ocean import Ocean
    from sim.environment.terrain import Terrain
    from sim.environment.things.bottom_map import BottomMap
    from sim.environment.things.pipelines import Pipeline
    from sim.environment.things.zones import Zone
    from sim.environment.wind import Wind

Edge = Annotated[float, Range(-1e5, 1e5, "m")]
Speed = Annotated[float, Range(-5.0, 5.0, "m/s")]
Angle = Annotated[float, Range(-pi, pi, "rad")]


_RELIEF_WITHIN = 50.0  # m
# From this number on, obstacles are cached as they were read, and are not checked again until a file changes. The two
# thousand obstacles of a chart would lengthen a slave's start of 0.1 s by a third.
_CACHE_FROM = 100
_CACHE_SUFFIX = ".obstacles"  # of the cache's name, after the world's file
_MAX_MESH_RADIUS = 5.0  # of a mesh, in lengths of the longer side of its world
# Readers of keys that many worlds lack: their modules are imported only for these.
READERS: dict[str, Reader] = {
    "mesh": reader_of("sim.environment.mesh:read_meshes"),
    "visual": reader_of("sim.environment.mesh:read_meshes"),
    "pipeline": reader_of("sim.environment.things.pipelines:Pipeline", many=True),
    "bottom_map": reader_of("sim.environment.things.bottom_map:read_bottom_map"),
    "zone": reader_of("sim.environment.things.zones:Zone", many=True),
    "terrain": reader_of("sim.environment.terrain:parse_terrain"),
    "ocean": reader_of("sim.environment.ocean:Ocean"),
    "wind": reader_of("sim.environment.wind:Wind"),
}


class World(NamedTuple):
    """The surroundings of a vehicle: water, seabed and obstacles. `source` names where the data come from.

    `extent` is north_min, north_max, east_min, east_max in m: the area of a map, and with `walls` the position of four
    walls. `depth` is that of the flat seabed; with `terrain` the seabed has a relief, and is flat only beyond it.
    `density` is that of the water in kg/m³, `gravity` in m/s², `current` the steady, uniform velocity of the water
    (north, east, down). `ocean` adds currents that change, waves and density layers, `wind` pushes what is above the
    water. `origin` is the latitude and longitude in degrees (WGS 84) at which north and east are 0, and
    `origin_altitude` (m) the height of the water's mean surface above the ellipsoid there.
    `magnetic_field` is the earth's: intensity in tesla, inclination (down positive) and declination (east positive) in
    rad. If left out it is that of the World Magnetic Model at the origin, and without an origin about that of central
    Europe (sim/environment/geomagnetism.py).
    `bottom` is the material of the seabed, for sonars and cameras; if left out the seabed is uniform, and smooth below
    the resolution of the grid.
    `zones` names a file with `[[zone]]` tables beside this one: see sim.environment.things.zones.
    `visual` are meshes that only cameras and views show: nothing touches them, and they have no echo.
    Not modelled: eddies, the lee of an obstacle.
    """

    name: str
    source: str
    extent: tuple[Edge, Edge, Edge, Edge]
    depth: Annotated[float, Range(0.1, 11_000.0, "m")]
    walls: bool = False
    density: Annotated[float, Range(900.0, 1200.0, "kg/m³")] = 1025.0
    gravity: Annotated[float, Range(0.1, 30.0, "m/s²")] = 9.80665
    current: tuple[Speed, Speed, Speed] = (0.0, 0.0, 0.0)
    origin: tuple[Annotated[float, Range(-90.0, 90.0, "deg")], Annotated[float, Range(-180.0, 180.0, "deg")]] | None = (
        None
    )
    origin_altitude: Annotated[float, Range(-500.0, 9000.0, "m")] = 0.0
    magnetic_field: tuple[Annotated[float, Range(0.0, 1e-3)], Angle, Angle] | None = None
    cylinder: tuple[Cylinder, ...] = ()
    box: tuple[Box, ...] = ()
    bottom: Bottom | None = None
    zones: str = ""
    ocean: "Ocean | None" = None  # READERS read this and the following sections
    wind: "Wind | None" = None
    terrain: "Terrain | None" = None
    mesh: "tuple[MeshObstacle, ...]" = ()
    visual: "tuple[MeshObstacle, ...]" = ()
    pipeline: "tuple[Pipeline, ...]" = ()
    bottom_map: "BottomMap | None" = None
    zone: "tuple[Zone, ...]" = ()

    def validate(self) -> str | None:
        """Return what is wrong with the combination of the keys, or None."""
        north_min, north_max, east_min, east_max = self.extent
        if north_min >= north_max or east_min >= east_max:
            return "extent: give north_min, north_max, east_min, east_max, each pair growing"
        placed: tuple[Cylinder | Box, ...] = (*self.cylinder, *self.box)
        return "\n".join(filter(None, map(self._validate_obstacle, placed))) or None

    def _validate_obstacle(self, obstacle: Cylinder | Box) -> str | None:
        north_min, north_max, east_min, east_max = self.extent
        north, east = obstacle.north, obstacle.east
        if obstacle.bottom <= obstacle.top:
            return f"the obstacle at ({north:g}, {east:g}) has its bottom above its top"
        if not (north_min <= north <= north_max and east_min <= east <= east_max):
            return f"the obstacle at ({north:g}, {east:g}) is outside the extent"
        return None

    def seabed(self, north: float, east: float) -> float:
        """Return the depth of the seabed at a position, in m."""
        return self.terrain.depth(north, east) if self.terrain else self.depth

    def obstacles(self) -> tuple[Obstacle, ...]:
        """Return all obstacles in the water, walls included."""
        return (*self.upright(), *self.mesh, *self.pipeline)

    def as_seen(self) -> "World":
        """Return the world as a camera sees it: with its `visual` meshes among the others."""
        return self._replace(mesh=(*self.mesh, *self.visual), visual=()) if self.visual else self

    def upright(self) -> tuple[Obstacle, ...]:
        """Return the obstacles with a horizontal outline, walls included: all except meshes and pipelines."""
        return (*self.cylinder, *self.box, *self._walls())

    def within(self, north: float, east: float, distance: float) -> list[Obstacle]:
        """Return the upright obstacles within `distance` m of a position: a quick selection that may contain more."""
        piles = [o for o in self.cylinder if abs(o[0] - north) < distance + o[2] and abs(o[1] - east) < distance + o[2]]
        blocks = [
            o for o in self.box
            if abs(o[0] - north) < distance + o[2] + o[3] and abs(o[1] - east) < distance + o[2] + o[3]
        ]  # fmt: skip
        return [*piles, *blocks, *self._walls()]

    def appearances(self) -> "Iterator[tuple[int, tuple[float, float, float] | None, float]]":
        """Yield of each mesh and pipeline its number in `obstacles` (from 1), colour (None: default) and echo (dB)."""
        number = len(self.upright())
        for mesh in self.mesh:
            number += 1
            yield number, mesh.keys.colour, mesh.keys.echo
        for pipeline in self.pipeline:
            number += 1
            yield number, pipeline.colour, pipeline.echo

    def validate_obstacles(self) -> str | None:
        """Return an error for an obstacle that is completely below the seabed, or None."""
        placed: tuple[Cylinder | Box, ...] = (*self.cylinder, *self.box)
        for obstacle in placed:
            if obstacle.top >= self.seabed(obstacle.north, obstacle.east):
                return f"the obstacle at ({obstacle.north:g}, {obstacle.east:g}) has its top in the seabed"
        return None

    def validate_meshes(self) -> str | None:
        """Return an error for a mesh that is completely below the seabed or outside the world, or None."""
        north_min, north_max, east_min, east_max = self.extent
        max_radius = _MAX_MESH_RADIUS * max(north_max - north_min, east_max - east_min)
        for mesh in self.mesh:
            if mesh.radius > max_radius:
                return (
                    f"{mesh.label} reaches {mesh.radius:.3g} m from its place, far out of the world: if its file is in "
                    "millimetres, scale = 0.001; if it is in coordinates of a map, move it to its own origin"
                )
            if not (north_min <= mesh.north <= north_max and east_min <= mesh.east <= east_max):
                return f"{mesh.label} is outside the extent"
            if all(down >= self.seabed(north, east) for north, east, down in mesh.corners()):
                return f"{mesh.label} has its top in the seabed"
        return None

    def spacing(self) -> float:
        """Return the length (m) of the straight pieces of a pipeline that follows the seabed."""
        return max(0.5, self.terrain.grid.resolution) if self.terrain else inf

    def all_zones(self) -> "tuple[Zone, ...]":
        """Return its zones, with those of its file of zones, which is read now. Raises ConfigError."""
        if not self.zones:
            return self.zone
        from sim.environment.things.zones import read_file

        return (*self.zone, *read_file(self.zones))

    def foot(self, obstacle: Obstacle, north: float, east: float) -> float:
        """Return the depth (m) of the lower end of an obstacle at a position: the seabed, unless it ends above."""
        return min(obstacle.bottom, self.seabed(north, east))

    def clearance(
        self, north: float, east: float, depth: float = inf, within: float = _RELIEF_WITHIN, height: float = inf
    ) -> float:
        """Return the distance (m) from a point to the nearest obstacle's side: negative inside, inf if there is none.

        Only obstacles between `depth` m and `height` m above it count, and a relief that is as shallow as `depth`
        within `within` m. If `depth` is left out, all obstacles count and the relief does not.
        """
        highest = depth - height if height < inf else -inf
        distances = (o.separation(north, east)[0] for o in self.upright() if o.top < depth and o.bottom > highest)
        least = min(distances, default=inf)
        for mesh in self.mesh:
            if mesh.top < depth and mesh.bottom > highest and mesh.separation(north, east)[0] < least:
                from sim.environment.contact.nearest import distance_to_mesh

                least = min(least, distance_to_mesh(mesh, north, east, highest, depth))
        for pipeline in self.pipeline:
            away = pipeline.separation(north, east)[0]
            if depth < inf and away < min(least, within):
                away = pipeline.distance(self.seabed, self.spacing(), north, east, highest, depth, min(least, within))
            least = min(least, away)
        if self.terrain is None or depth == inf:
            return least
        from sim.environment.shallows import distance_to_shallows

        return min(least, distance_to_shallows(self.terrain, north, east, depth, min(least, within)))

    def _walls(self) -> tuple[Wall, ...]:
        if not self.walls:
            return ()
        north_min, north_max, east_min, east_max = self.extent
        return (
            Wall(1.0, 0.0, north_min),
            Wall(-1.0, 0.0, -north_max),
            Wall(0.0, 1.0, east_min),
            Wall(0.0, -1.0, -east_max),
        )


def load_world(name_or_path: str) -> World:
    """Return the world of a preset of `sim/worlds` or of a `.toml` file. Raises ConfigError."""
    path = find_preset("sim/worlds", name_or_path)
    stamp = (*check_file(path, LARGEST), Cylinder._fields, Box._fields)
    cached = read_cached(path + _CACHE_SUFFIX, stamp)
    table, piles, blocks, cached_stamp = cached or (read_table(path), (), (), None)
    world = _read(table, path)
    if cached:
        world = world._replace(cylinder=tuple(map(Cylinder._make, piles)), box=tuple(map(Box._make, blocks)))
    terrain_stamp = _terrain_stamp(table.get("terrain"), path)
    is_checked = bool(cached) and terrain_stamp == cached_stamp
    problems = [None if is_checked else world.validate_obstacles(), world.validate_meshes()]
    if any(problems):
        raise ConfigError(*[f"{path}: {problem}" for problem in problems if problem])
    if len(world.cylinder) + len(world.box) >= _CACHE_FROM and not is_checked:
        rest = {key: value for key, value in table.items() if key not in ("cylinder", "box")}
        piles, blocks = [*map(tuple, world.cylinder)], [*map(tuple, world.box)]
        write_cached(path + _CACHE_SUFFIX, stamp, (rest, piles, blocks, terrain_stamp))
    if world.terrain is not None:
        world.terrain.unmap()  # release the pages that were read to check the obstacles
    return world


def _terrain_stamp(terrain: "dict[str, Any] | None", path: str) -> "Stamp | None":
    """Return time and size of the file with the depths of a `[terrain]`; None if they are not in a file."""
    if terrain is None or "file" not in terrain:
        return None
    return check_file(os.path.join(os.path.dirname(path), str(terrain["file"])), sys.maxsize)


def _read(table: dict[str, Any], path: str) -> World:
    """Return the world of a file's table: its keys first, then what depends on several of them. Raises ConfigError."""
    shapes: list[Any] = []
    read_shapes = reader_of("sim.environment.things.shapes:parse_shapes")
    readers = {**READERS, "shape": lambda rows, where: shapes.extend(read_shapes(rows, where))}
    world = parse(table, World, path, readers)
    if world.zones:
        world = world._replace(zones=os.path.join(os.path.dirname(path), world.zones))
    keys: Any = world.terrain
    if keys:
        from sim.environment.terrain import make_terrain

        world = world._replace(terrain=make_terrain(keys, path, world.extent, world.depth))
    if shapes:
        from sim.environment.things.shapes import place_shapes

        world = world._replace(mesh=(*world.mesh, *place_shapes(shapes, world.seabed)))
    return world


def water_pressure(world: World) -> "Callable[[float], float]":
    """Return a function from depth (m) to the pressure of the water of `world` above air pressure (Pa); 0 in air."""
    if world.ocean and world.ocean.profile:
        from sim.environment.seawater.water_column import WaterColumn

        return WaterColumn(world.ocean.profile, world.gravity).pressure
    from sim.environment.seawater.pressure import pressure_at

    weight = world.density * world.gravity
    return lambda depth: pressure_at(depth, weight)
