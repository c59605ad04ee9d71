"""Charted objects other than depths and obstacles: cables, pipelines, regulated areas, and the nature of the bed.

A chart seldom gives the diameter of a pipeline or cable: that in sources/objects.toml is assumed. They lie on the bed
unless charted as buried. A chart gives the nature of the bed at points: each node of the bed takes that of the nearest
point within `NATURE_REACH`.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.autonomy.paths.polygons import Edges, fill
from hil.charts.grid import Extent, Grid
from hil.charts.sources.s57 import Feature
from hil.charts.sources.s57_process import OBJECTS, RULES
from sim.environment.obstacles import ZoneKind
from sim.environment.things.bottom_map import UNKNOWN
from sim.environment.things.natures import NATURES
from sim.environment.things.pipelines import Pipeline
from sim.environment.things.zones import Zone

Array = NDArray[np.float64]
Codes = NDArray[np.uint8]

NATURE_REACH = 100.0  # times the accuracy of a drawn line: 5 cm on paper
BOTTOM_STEP = 2  # nodes of the depth grid per node of the bottom grid, along a side
_KNOWN = {nature.code for nature in NATURES.values()}


class Nature(NamedTuple):
    """One charted nature of the bed: S-57 code (NATSUR), at points (n, 2) or within edges."""

    code: int
    positions: Array
    edges: Edges = ()


class ChartedObjects(NamedTuple):
    """Objects of charts other than depths and obstacles, on the plane, from the coarsest chart to the finest."""

    pipelines: tuple[Pipeline, ...] = ()
    zones: tuple[Zone, ...] = ()
    natures: tuple[Nature, ...] = ()


class BottomGrid(NamedTuple):
    """S-57 codes of the bed's nature, (rows, columns), 0 for unknown; position of the first node and spacing, m."""

    codes: Codes
    north_min: float
    east_min: float
    resolution: float


def pipelines_of(feature: Feature, lines: list[Array]) -> list[Pipeline]:
    """Return the pipelines or cables of a chart object, along `lines` (n, 2); none for other objects."""
    diameter: float | None = OBJECTS[feature.kind].get("diameter")
    if diameter is None:
        return []
    buried = feature.number("BURDEP") or 0.0
    is_cable = feature.kind == "CBLSUB"
    height = -(buried + diameter) if buried > 0.0 else 0.0
    return [
        Pipeline(_rounded(line), diameter, height, "cable" if is_cable else "pipeline", name=feature.name)
        for line in lines
        if len(line) > 1
    ]


def zones_of(feature: Feature, edges: Edges, detail: float) -> list[Zone]:
    """Return the zones of a chart object, their outlines simplified to `detail` m; none for other objects."""
    kind: ZoneKind | None = OBJECTS[feature.kind].get("zone")
    if kind is None or not feature.is_area or not edges:
        return []
    import shapely

    area = shapely.build_area(shapely.GeometryCollection([shapely.LineString(edge) for edge in edges]))
    polygons = shapely.get_parts(area.simplify(detail))
    rules = ", ".join(RULES[str(code)] for code in feature.codes.get("RESTRN", ()) if str(code) in RULES)
    return [
        Zone(kind, _rounded(np.asarray(part.exterior.coords)[:-1]), feature.name, rules)
        for part in polygons
        if len(part.exterior.coords) > 3
    ]


def nature_of(feature: Feature, points: Array, edges: Edges) -> Nature | None:
    """Return the nature of the bed in a chart object; of several materials the first, which is the predominant one."""
    codes = [code for code in feature.codes.get("NATSUR", ()) if code in _KNOWN]
    if feature.kind != "SBDARE" or not codes:
        return None
    return Nature(codes[0], points, edges if feature.is_area else ())


def clip_charted(charted: ChartedObjects, extent: Extent) -> ChartedObjects:
    """Return the objects that touch `extent` (m), with zones cut at its border."""
    import shapely

    south, north, west, east = extent
    frame = shapely.box(south, west, north, east)
    lines = tuple(line for line in charted.pipelines if frame.intersects(shapely.LineString(line.points)))
    zones = [
        zone._replace(outline=_rounded(np.asarray(part.exterior.coords)[:-1]))
        for zone in charted.zones
        for part in shapely.get_parts(shapely.Polygon(zone.outline).buffer(0.0).intersection(frame))
        if part.geom_type == "Polygon" and len(part.exterior.coords) > 3
    ]
    return charted._replace(pipelines=lines, zones=tuple(zones))


def rasterise_natures(natures: tuple[Nature, ...], grid: Grid, detail: float) -> BottomGrid | None:
    """Return the nature of the bed of `grid`, None if it is unknown everywhere."""
    if not natures:
        return None
    from scipy.spatial import cKDTree

    north, east = grid.north[::BOTTOM_STEP], grid.east[::BOTTOM_STEP]
    codes = np.full((len(north), len(east)), UNKNOWN, np.uint8)
    positions = np.concatenate([np.empty((0, 2)), *(nature.positions for nature in natures)])
    numbers = np.concatenate([[], *(np.full(len(nature.positions), nature.code) for nature in natures)])
    if len(positions):
        nodes = np.stack(np.meshgrid(north, east, indexing="ij"), axis=-1)
        distance, nearest = cKDTree(positions).query(nodes, distance_upper_bound=NATURE_REACH * detail)
        found = np.isfinite(distance)
        codes[found] = numbers[nearest[found]]
    for nature in natures:
        window, inside = fill(nature.edges, north, east)
        codes[window][inside] = nature.code
    if not codes.any():
        return None
    return BottomGrid(codes, float(north[0]), float(east[0]), BOTTOM_STEP * grid.resolution)


def cut_bottom_grid(bottom: BottomGrid | None, extent: Extent) -> BottomGrid | None:
    """Return the part of `bottom` that covers `extent` (m)."""
    if bottom is None:
        return None
    first, counts = np.array((bottom.north_min, bottom.east_min)), np.array(bottom.codes.shape)
    low, high = (np.array(ends) - first for ends in (extent[::2], extent[1::2]))
    start = np.clip(np.floor(low / bottom.resolution).astype(int), 0, counts - 1)
    end = np.clip(np.ceil(high / bottom.resolution).astype(int) + 1, start + 1, counts)
    codes = bottom.codes[start[0] : end[0], start[1] : end[1]].copy()
    north, east = (first + start * bottom.resolution).tolist()
    return BottomGrid(codes, north, east, bottom.resolution)


def _rounded(line: Array) -> tuple[tuple[float, float], ...]:
    return tuple((round(float(north), 2), round(float(east), 2)) for north, east in line)
