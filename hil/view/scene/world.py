"""The world in the scene: seabed shaded by depth with contours, water surface, obstacles, current, path and goal."""

from collections.abc import Sequence
from math import ceil
from typing import Any

import numpy as np

from hil.view.scene import colours
from hil.view.scene.frames import to_scene
from sim.environment.obstacles import Box, Cylinder
from sim.environment.things.pipelines import Pipeline
from sim.environment.things.zones import Zone
from sim.environment.world import World

MAX_NODES = 400  # per side of the drawn seabed: 320,000 triangles, which a browser can still rotate without a GPU
CONTOURS = 10
CURRENT_ARROWS = 6  # per side
STEPS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0)  # m between contours
SHALLOW, DEEP = np.array([214.0, 200.0, 160.0]), np.array([24.0, 60.0, 110.0])  # colours: sand to deep blue
SURFACE_OPACITY = 0.06
OPACITY = 0.35  # for obstacles and nets


class WorldScene:
    """Scene of all objects that do not move, such as seabed and obstacles. `server` is a viser.ViserServer."""

    def __init__(self, server: Any, world: World) -> None:
        self._scene = server.scene
        self.world = world
        norths, easts, depths = nodes(world)
        self.deepest = float(np.nanmax(depths))
        self._draw_seabed(norths, easts, depths)
        self._draw_contours(norths, easts, depths)
        self._draw_surface(norths, easts)
        placed: tuple[Cylinder | Box, ...] = (*world.cylinder, *world.box)
        for number, obstacle in enumerate(placed):
            self._draw_obstacle(number, obstacle)
        for number, mesh in enumerate(world.as_seen().mesh):
            corners = np.array(mesh.placed).reshape(-1, 3)
            faces = np.arange(len(corners)).reshape(-1, 3)
            colour = colours.bytes_of(mesh.keys.colour) if mesh.keys.colour else colours.OBSTACLE
            self._scene.add_mesh_simple(
                f"/meshes/{number}", to_scene(corners), faces, color=colour, side="double",
                opacity=OPACITY if mesh.net else None,
            )  # fmt: skip
        for number, pipeline in enumerate(world.pipeline):
            self._draw_pipeline(number, pipeline)
        for number, zone in enumerate(world.all_zones()):
            self._draw_zone(number, zone)
        if any(world.current):
            self._draw_current()

    def seabed(self, north: float, east: float) -> float:
        """Return the depth of the seabed (m) at a position (NED, m)."""
        return self.world.seabed(north, east)

    def draw_path(self, path: Sequence[Sequence[float]], depth: float, name: str = "path") -> None:
        """Draw a planned path: points (NED, m); those without a depth are at `depth`. It replaces one of that name."""
        points = [(point[0], point[1], point[2] if len(point) > 2 else depth) for point in path]
        if len(points) > 1:
            lines = to_scene(points)
            segments = np.stack([lines[:-1], lines[1:]], axis=1)
            self._scene.add_line_segments(f"/{name}", segments, colours.PATH, thickness=3.0, thickness_units="screen")

    def draw_goal(self, north: float, east: float, depth: float) -> None:
        """Draw the goal of the mission (NED, m)."""
        place = to_scene([(north, east, depth)])[0]
        self._scene.add_icosphere("/goal", 0.35, colours.GOAL, position=place)
        self._scene.add_label("/goal/name", "goal", position=(0.0, 0.0, 0.6))

    def _draw_seabed(self, norths: Any, easts: Any, depths: Any) -> None:
        import trimesh

        places, faces = triangles(norths, easts, depths)
        shade = np.clip(places[:, 2:] / max(self.deepest, 0.1), 0.0, 1.0)
        mesh = trimesh.Trimesh(
            to_scene(places), faces, vertex_colors=(SHALLOW + (DEEP - SHALLOW) * shade).astype(np.uint8), process=False
        )
        self._scene.add_mesh_trimesh("/seabed", mesh, cast_shadow=False)

    def _draw_contours(self, norths: Any, easts: Any, depths: Any) -> None:
        from contourpy import contour_generator

        least, most = float(np.nanmin(depths)), float(np.nanmax(depths))
        if most - least < 0.05:
            return
        step = next((step for step in STEPS if (most - least) / step <= CONTOURS), STEPS[-1])
        lines = contour_generator(easts, norths, np.ma.masked_invalid(depths))
        for number in range(ceil(least / step), int(most // step) + 1):
            level = number * step
            contours: Any = lines.lines(level)
            parts = [np.stack([line[:-1], line[1:]], axis=1) for line in contours if len(line) > 1]
            if parts:
                flat = np.concatenate(parts)
                heights = np.full((*flat.shape[:2], 1), -level + 0.02)
                segments = np.concatenate([flat, heights], axis=2)
                self._scene.add_line_segments(
                    f"/contours/{number}", segments, colours.CONTOUR, thickness=1.0, thickness_units="screen"
                )
                self._scene.add_label(f"/contours/{number}/depth", f"{level:g} m", position=segments[len(flat) // 2, 0])

    def _draw_surface(self, norths: Any, easts: Any) -> None:
        corners = [(n, e, 0.0) for n in (norths[0], norths[-1]) for e in (easts[0], easts[-1])]
        self._scene.add_mesh_simple(
            "/surface", to_scene(corners), np.array([(0, 1, 3), (0, 3, 2)]), color=colours.WATER,
            opacity=SURFACE_OPACITY, side="double", cast_shadow=False, receive_shadow=False,
        )  # fmt: skip

    def _draw_obstacle(self, number: int, obstacle: Cylinder | Box) -> None:
        bottom = self.world.foot(obstacle, obstacle.north, obstacle.east)
        top = max(obstacle.top, -0.5)  # cut off above the water, where it would hide the vehicles
        height, middle = max(bottom - top, 0.1), (obstacle.north, obstacle.east, 0.5 * (bottom + top))
        name, point = f"/obstacles/{number}", to_scene([middle])[0]
        if isinstance(obstacle, Cylinder):
            self._scene.add_cylinder(
                name, obstacle.radius, height, color=colours.OBSTACLE, position=point, opacity=OPACITY
            )
            return
        half = -0.5 * obstacle.heading
        size = (obstacle.size_east, obstacle.size_north, height)
        turn = (float(np.cos(half)), 0.0, 0.0, float(np.sin(half)))
        self._scene.add_box(name, color=colours.OBSTACLE, dimensions=size, position=point, wxyz=turn, opacity=OPACITY)

    def _draw_pipeline(self, number: int, pipeline: Pipeline) -> None:
        pieces = list(pipeline.drawn(self.world.seabed, self.world.spacing()))
        if pieces:
            segments = to_scene(np.array(pieces).reshape(-1, 3)).reshape(-1, 2, 3)
            self._scene.add_line_segments(
                f"/pipelines/{number}", segments, colours.bytes_of(pipeline.colour), thickness=pipeline.diameter,
                thickness_units="world",
            )  # fmt: skip
            self._scene.add_label(f"/pipelines/{number}/name", pipeline.label, position=segments[len(pieces) // 2, 0])

    def _draw_zone(self, number: int, zone: Zone) -> None:
        corners = to_scene([(north, east, 0.0) for north, east in (*zone.outline, zone.outline[0])])
        segments = np.stack([corners[:-1], corners[1:]], axis=1)
        self._scene.add_line_segments(
            f"/zones/{number}", segments, colours.ZONE, thickness=2.0, thickness_units="screen"
        )
        self._scene.add_label(f"/zones/{number}/name", zone.label, position=corners[0])

    def _draw_current(self) -> None:
        south, north, west, east = self.world.extent
        points = [
            (n, e, 0.5 * self.world.seabed(n, e))
            for n in np.linspace(south, north, CURRENT_ARROWS + 2)[1:-1]
            for e in np.linspace(west, east, CURRENT_ARROWS + 2)[1:-1]
        ]
        reach = 0.6 * min(north - south, east - west) / CURRENT_ARROWS
        speed = max(float(np.linalg.norm(self.world.current)), 1e-9)
        along = np.array(self.world.current) * reach / speed
        segments = arrows(to_scene(points), to_scene([along])[0])
        self._scene.add_line_segments("/current", segments, colours.CURRENT, thickness=2.0, thickness_units="screen")


def arrows(starts: Any, along: Any) -> Any:
    """Return line segments (n x 2 x 3) of arrows from `starts` (k x 3), each as long as `along` (3, or k x 3)."""
    starts, along = np.asarray(starts, float), np.broadcast_to(np.asarray(along, float), np.shape(starts))
    ends = starts + along
    side = np.cross(along, (0.0, 0.0, 1.0))
    side = np.where(np.linalg.norm(side, axis=1, keepdims=True) < 1e-9, np.cross(along, (1.0, 0.0, 0.0)), side)
    head = [ends - 0.25 * along + sign * 0.12 * side / _length(side) * _length(along) for sign in (1.0, -1.0)]
    return np.concatenate([np.stack([starts, ends], 1), *[np.stack([ends, tip], 1) for tip in head]])


def _length(vectors: Any) -> Any:
    return np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-9)


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
