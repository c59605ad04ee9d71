"""Combine charts on one plane: where they overlap, the chart of the largest scale is used."""

from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.autonomy.paths.polygons import Edges, Mask, contains
from hil.charts.chart_check import check_chart
from hil.charts.charted_objects import ChartedObjects, Nature, nature_of, pipelines_of, zones_of
from hil.charts.hazards import hazards_of
from hil.charts.projection import LocalPlane
from hil.charts.sources.s57 import Cell, Feature
from hil.charts.sources.s57_process import OBJECTS
from hil.charts.sources.survey import DepthArea, Hazard, Sheet, Survey, first_in_cell, resample
from hil.common.errors import ConfigError
from sim.environment.things.pipelines import Pipeline
from sim.environment.things.zones import Zone

Array = NDArray[np.float64]
Codes = NDArray[np.int64]

LINE_ACCURACY = 0.0005  # m on paper: accuracy of a drawn line (IHO S-4), and so the detail of a chart's bed
# Spacing of points on contours and coasts, as a share of the distance between soundings. Denser points would outweigh
# the soundings.
GUIDE_SPACING = 0.35
GUIDE_SPACING_ON_PAPER = 0.004  # m on paper, used for a chart that has fewer than two soundings
PARALLEL_STEP = 0.25  # degrees of longitude, over which a parallel departs from a straight line by 7 m at most
LEAST_DEPTHS = 3  # of soundings and guides
UNSTATED = "states no coverage: that of its areas of water and land is used"
BARE = "has no soundings: its bed is that of its contours, coasts and depth areas"
# Objects that cover all of a chart without overlap (S-57 appendix B.1, 3.10.1)
GROUP_1 = ("DEPARE", "DRGARE", "LNDARE", "UNSARE", "PONTON", "HULKES", "FLODOC")
# Greatest height of a coast, m above the water: the slope of a beach says little about the bed in front of it.
MAX_DRYING_HEIGHT = 1.0


class GeoBox(NamedTuple):
    """An area between two parallels and two meridians, degrees. `east` is above 180 if it crosses that meridian."""

    south: float
    west: float
    north: float
    east: float

    @property
    def centre(self) -> tuple[float, float]:
        """Latitude and longitude of the centre."""
        return 0.5 * (self.south + self.north), 0.5 * (self.west + self.east)


def coverage_box(cells: list[Cell]) -> GeoBox:
    """Return the box around the coverage of all charts. Raises ConfigError if they state none."""
    lines = [line for cell in cells for feature in _coverage(cell) for line in feature.lines]
    if not lines:
        raise ConfigError(
            f"{cells[0].name}: the chart has neither its coverage (M_COVR) nor areas of water and land: get another ENC"
        )
    for cell in cells:
        check_chart(cell, _coverage(cell))
    corners = np.concatenate(lines)
    if np.ptp(corners[:, 0]) > 180.0:  # on both sides of the 180th meridian
        corners = np.column_stack([corners[:, 0] % 360.0, corners[:, 1]])
    return GeoBox(*corners.min(axis=0)[::-1].tolist(), *corners.max(axis=0)[::-1].tolist())


def survey_charts(cells: list[Cell], plane: LocalPlane) -> Survey:
    """Return the contents of `cells` on `plane`. Raises ConfigError if they have no depths."""
    layers = [_ChartLayer(cell, plane) for cell in sorted(cells, key=lambda cell: -cell.scale)]
    pairs = [(layer, [finer.coverage for finer in layers[i + 1 :]]) for i, layer in enumerate(layers)]
    soundings = np.concatenate([_outside(layer.soundings(), covers) for layer, covers in pairs])
    guides = np.concatenate([_outside(layer.guides(), covers) for layer, covers in pairs])
    names = ", ".join(cell.name for cell in cells)
    if len(soundings) + len(guides) < LEAST_DEPTHS:
        raise ConfigError(
            f"{names}: no soundings or contours: use another chart of the place, of a larger scale "
            "(third letter of the name: 4, 5)"
        )
    return Survey(
        source="; ".join(f"ENC {c.name} edition {c.edition} update {c.update} 1:{c.scale}" for c in cells),
        origin=(plane.latitude, plane.longitude),
        soundings=soundings,
        guides=guides,
        strikes=np.concatenate([_outside(layer.strikes(), covers) for layer, covers in pairs]),
        detail=LINE_ACCURACY * min(cell.scale for cell in cells),
        sheets=tuple(layer.sheet() for layer in layers),
        hazards=tuple(
            hazard
            for layer, covers in pairs
            for hazard in layer.hazards()
            if _are_outside(hazard.line[:1], covers).all()
        ),
        contours=tuple(
            (piece, depth)
            for layer, covers in pairs
            for line, depth in layer.contours()
            for piece in _cut_line(line, covers)
        ),
        shore=_cut_lines(pairs, "COALNE", "SLCONS"),
        bridges=_cut_lines(pairs, "BRIDGE"),
        notes=(
            *(note for cell in cells for note in cell.notes),
            *(f"{cell.name}: {UNSTATED}" for cell in cells if not _stated_coverage(cell)),
            *([] if len(soundings) else [f"{names}: {BARE}"]),
        ),
        charted=ChartedObjects(
            tuple(pipeline for layer, covers in pairs for pipeline in layer.pipelines(covers)),
            tuple(zone for layer in layers for zone in layer.zones()),
            tuple(nature for layer, covers in pairs for nature in layer.natures(covers)),
        ),
    )


def _codes(corners: Array) -> Codes:
    """Return one number for each corner (n, 2), equal for equal positions: objects of a chart share corners exactly."""
    centimetres = np.round(100.0 * corners).astype(np.int64)
    return np.asarray(centimetres[:, 0] * (1 << 32) + centimetres[:, 1])


def _coverage(cell: Cell) -> list[Feature]:
    """Return the areas that a chart covers; of one that does not state them, all of group 1, which share no point."""
    return _stated_coverage(cell) or [feature for feature in cell.select(*GROUP_1) if feature.is_area]


def _stated_coverage(cell: Cell) -> list[Feature]:
    return [feature for feature in cell.select("M_COVR") if feature.number("CATCOV") == 1]


def _along_parallels(line: Array) -> Array:
    """Return `line` (n, 2; longitude, latitude) with corners at most PARALLEL_STEP apart: a parallel is curved."""
    along = np.diff(line, axis=0)
    along[:, 0] = (along[:, 0] + 180.0) % 360.0 - 180.0
    counts = np.maximum(1, np.ceil(np.abs(along[:, 0]) / PARALLEL_STEP)).astype(np.intp)
    if (counts <= 1).all():
        return line
    which = np.repeat(np.arange(len(along)), counts)
    share = (np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)) / counts[which]
    return np.asarray(np.vstack([line[which] + share[:, None] * along[which], line[-1:]]))


def _are_outside(points: Array, covers: list[Edges]) -> Mask:
    mask = np.ones(len(points), bool)
    for edges in covers:
        mask &= ~contains(edges, points[:, :2])
    return mask


def _outside(points: Array, covers: list[Edges]) -> Array:
    return points[_are_outside(points, covers)]


def _cut_line(line: Array, covers: list[Edges]) -> list[Array]:
    """Return the pieces of `line` outside the coverage of finer charts."""
    if not covers:
        return [line]
    is_outside = _are_outside(line, covers)
    runs = np.split(np.arange(len(line)), np.flatnonzero(np.diff(is_outside)) + 1)
    return [line[run] for run in runs if is_outside[run[0]] and len(run) > 1]


def _cut_lines(pairs: list[tuple["_ChartLayer", list[Edges]]], *kinds: str) -> tuple[Array, ...]:
    return tuple(piece for layer, covers in pairs for line in layer.lines(*kinds) for piece in _cut_line(line, covers))


class _ChartLayer:
    """The contents of one chart, with positions on the plane."""

    def __init__(self, cell: Cell, plane: LocalPlane) -> None:
        self._cell, self._plane = cell, plane
        self.coverage: Edges = tuple(edge for feature in _coverage(cell) for edge in self._edges(feature))

    def soundings(self) -> Array:
        features = self._cell.select("SOUNDG")
        points = [np.column_stack([self._local(f.points), f.points[:, 2]]) for f in features]
        return np.concatenate([np.empty((0, 3)), *points])

    def contours(self) -> list[tuple[Array, float]]:
        known = [(feature, feature.number("VALDCO")) for feature in self._cell.select("DEPCNT")]
        return [(edge, depth) for feature, depth in known if depth is not None for edge in self._edges(feature)]

    def guides(self) -> Array:
        """Return points on contours and coasts, (n, 3). A coast is at 0 m, or above where the area before it dries."""
        points = [np.insert(resample(line, self._guide_spacing), 2, depth, axis=1) for line, depth in self.contours()]
        places = np.concatenate([np.empty((0, 3)), *points, *map(self._coast_guides, self.lines("COALNE"))])
        return np.asarray(places[first_in_cell(places, 0.5 * self._guide_spacing)])

    def strikes(self) -> Array:
        """Return the segments of contours and coasts, (n, 4): centres and vectors."""
        lines = [*(line for line, _ in self.contours()), *self.lines("COALNE")]
        places = [resample(line, self._guide_spacing) for line in lines]
        pieces = [np.hstack([0.5 * (p[1:] + p[:-1]), np.diff(p, axis=0)]) for p in places]
        return np.concatenate([np.empty((0, 4)), *pieces])

    @cached_property
    def _guide_spacing(self) -> float:
        """Spacing of the guides, m."""
        from scipy.spatial import cKDTree

        soundings = self.soundings()[:, :2]
        if len(soundings) < 2:
            return GUIDE_SPACING_ON_PAPER * self._cell.scale
        nearest = cKDTree(soundings).query(soundings, 2)[0][:, 1]
        return max(GUIDE_SPACING * float(np.median(nearest)), LINE_ACCURACY * self._cell.scale)

    def _coast_guides(self, coast: Array) -> Array:
        """Return points along a coast next to depth areas, (n, 3): at 0 m, or above where the area dries."""
        codes, depths = self._area_corners
        if not len(codes):
            return np.empty((0, 3))
        wanted = _codes(coast)
        at = np.minimum(np.searchsorted(codes, wanted), len(codes) - 1)
        depth = np.where(codes[at] == wanted, np.clip(depths[at], -MAX_DRYING_HEIGHT, 0.0), np.nan)
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(coast, axis=0).T))])
        places = resample(coast, self._guide_spacing)
        found = np.interp(np.linspace(0.0, along[-1], len(places)), along, depth)
        return np.asarray(np.column_stack([places, found])[np.isfinite(found)])

    @cached_property
    def _area_corners(self) -> tuple[Codes, Array]:
        """Return the codes of the corners of all depth areas, sorted, and the least shoal limit (m) at each."""
        areas = [(np.concatenate(area.edges), area.low) for area in self._areas() if np.isfinite(area.low)]
        if not areas:
            return np.empty(0, np.int64), np.empty(0)
        codes = np.concatenate([_codes(corners) for corners, _ in areas])
        lows = np.concatenate([np.full(len(corners), low) for corners, low in areas])
        order = np.lexsort((lows, codes))
        codes, first = np.unique(codes[order], return_index=True)
        return codes, lows[order][first]

    def sheet(self) -> Sheet:
        return Sheet(
            self._cell.name, self.coverage, tuple(self._areas()), tuple(self._bounded("LNDARE")),
            tuple(self._bounded("UNSARE")),
        )  # fmt: skip

    def hazards(self) -> list[Hazard]:
        return [
            hazard for feature in self._cell.features
            for hazard in hazards_of(feature, self._local(feature.points), self._edges(feature))
        ]  # fmt: skip

    def pipelines(self, covers: list[Edges]) -> list[Pipeline]:
        return [
            pipeline for feature in self._cell.features if "diameter" in OBJECTS[feature.kind]
            for pipeline in pipelines_of(feature, [p for edge in self._edges(feature) for p in _cut_line(edge, covers)])
        ]  # fmt: skip

    def zones(self) -> list[Zone]:
        detail = LINE_ACCURACY * self._cell.scale
        return [
            zone for feature in self._cell.features if "zone" in OBJECTS[feature.kind]
            for zone in zones_of(feature, self._edges(feature), detail)
        ]  # fmt: skip

    def natures(self, covers: list[Edges]) -> list[Nature]:
        found = [
            nature_of(feature, _outside(self._local(feature.points), covers), self._edges(feature))
            for feature in self._cell.select("SBDARE")
        ]
        return [nature for nature in found if nature is not None]

    def lines(self, *kinds: str) -> list[Array]:
        return [edge for feature in self._cell.select(*kinds) for edge in self._edges(feature)]

    def _areas(self) -> list[DepthArea]:
        areas = []
        for feature in self._cell.select("DEPARE", "DRGARE"):
            low, high = feature.number("DRVAL1"), feature.number("DRVAL2")
            if feature.is_area:
                areas.append(DepthArea(
                    self._edges(feature), -np.inf if low is None else low, np.inf if high is None else high
                ))  # fmt: skip
        return areas

    def _bounded(self, kind: str) -> list[Edges]:
        return [self._edges(feature) for feature in self._cell.select(kind) if feature.is_area]

    def _edges(self, feature: Feature) -> Edges:
        return tuple(self._local(_along_parallels(line)) for line in feature.lines)

    def _local(self, positions: Array) -> Array:
        return np.column_stack(self._plane.to_local(positions[:, 1], positions[:, 0]))
