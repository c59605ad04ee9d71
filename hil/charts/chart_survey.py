"""Combine charts on one plane: where they overlap, the larger scale is used."""

from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.autonomy.paths.polygons import Edges, contains
from hil.charts.charted import DIAMETERS, ZONES, Charted, Nature, nature_of, pipelines_of, zones_of
from hil.charts.hazards import hazards_of
from hil.charts.projection import LocalPlane
from hil.charts.sources.s57 import Cell, Feature
from hil.charts.sources.survey import DepthArea, Hazard, Sheet, Survey, first_in_cell, resample
from hil.common.errors import ConfigError
from sim.environment.things.pipelines import Pipeline
from sim.environment.things.zones import Zone

Array = NDArray[np.float64]
Codes = NDArray[np.int64]

DRAWN = 0.0005  # m on paper: a line is drawn no finer (IHO S-4), and a grid of a chart's bed has no more detail
# Places on contours and coasts are so far apart, in the distance from a sounding to the next: nearer ones outweigh it.
GUIDES_APART = 0.35
PAPER_APART = 0.002  # m on paper instead, of a chart that has fewer than two soundings
MOST_BEACH = 1.0  # m that a coast counts as dry: how steep a beach is shows little of the bed before it


class Box(NamedTuple):
    """A piece of the earth, degrees."""

    south: float
    west: float
    north: float
    east: float

    @property
    def centre(self) -> tuple[float, float]:
        """Its middle: latitude, longitude."""
        return 0.5 * (self.south + self.north), 0.5 * (self.west + self.east)


def covered(cells: list[Cell]) -> Box:
    """Return the box around all that the charts cover."""
    lines = [line for cell in cells for feature in _coverage(cell) for line in feature.lines]
    if not lines:
        raise ConfigError(f"{cells[0].name}: the chart does not say what it covers (M_COVR): it is no usable ENC")
    corners = np.concatenate(lines)
    if np.ptp(corners[:, 0]) > 180.0:  # on both sides of the 180th meridian
        corners = np.column_stack([corners[:, 0] % 360.0, corners[:, 1]])
    return Box(*corners.min(axis=0)[::-1].tolist(), *corners.max(axis=0)[::-1].tolist())


def survey_charts(cells: list[Cell], plane: LocalPlane) -> Survey:
    """Return the contents of `cells`, on `plane`. Raises ConfigError."""
    layers = [_Layer(cell, plane) for cell in sorted(cells, key=lambda cell: -cell.scale)]
    finer: list[list[Edges]] = [[other.coverage for other in layers[i + 1 :]] for i in range(len(layers))]
    pairs = list(zip(layers, finer, strict=True))
    soundings = np.concatenate([_outside(layer.soundings(), covers) for layer, covers in pairs])
    if not len(soundings):
        names = ", ".join(cell.name for cell in cells)
        raise ConfigError(f"{names}: no soundings: take a chart of a larger scale (third letter of its name: 4 or 5)")
    return Survey(
        source="; ".join(_label(cell) for cell in cells),
        origin=(plane.latitude, plane.longitude),
        soundings=soundings,
        guides=np.concatenate([_outside(layer.guides(), covers) for layer, covers in pairs]),
        strikes=np.concatenate([_outside(layer.strikes(), covers) for layer, covers in pairs]),
        detail=DRAWN * min(cell.scale for cell in cells),
        sheets=tuple(layer.sheet() for layer in layers),
        hazards=tuple(hazard for layer, covers in pairs for hazard in layer.hazards() if _is_free(hazard, covers)),
        contours=tuple(
            (piece, depth)
            for layer, covers in pairs
            for line, depth in layer.contours()
            for piece in _cut(line, covers)
        ),
        shore=_cut_all(pairs, "COALNE", "SLCONS"),
        bridges=_cut_all(pairs, "BRIDGE"),
        charted=Charted(
            tuple(pipeline for layer, covers in pairs for pipeline in layer.pipelines(covers)),
            tuple(zone for layer in layers for zone in layer.zones()),
            tuple(nature for layer, covers in pairs for nature in layer.natures(covers)),
        ),
    )


def _codes(corners: Array) -> Codes:
    """Return one number for each corner (n, 2), the same for those of one place: charts share them exactly."""
    centimetres = np.round(100.0 * corners).astype(np.int64)
    return np.asarray(centimetres[:, 0] * (1 << 32) + centimetres[:, 1])


def _label(cell: Cell) -> str:
    return f"ENC {cell.name} edition {cell.edition} update {cell.update} 1:{cell.scale}"


def _coverage(cell: Cell) -> list[Feature]:
    return [feature for feature in cell.select("M_COVR") if feature.number("CATCOV") == 1]


def _outside(points: Array, covers: list[Edges]) -> Array:
    keep = np.ones(len(points), bool)
    for edges in covers:
        keep &= ~contains(edges, points[:, :2])
    return points[keep]


def _cut(line: Array, covers: list[Edges]) -> list[Array]:
    """Return the pieces of `line` that no finer chart covers."""
    if not covers:
        return [line]
    keep = np.ones(len(line), bool)
    for edges in covers:
        keep &= ~contains(edges, line)
    runs = np.split(np.arange(len(line)), np.flatnonzero(np.diff(keep)) + 1)
    return [line[run] for run in runs if keep[run[0]] and len(run) > 1]


def _cut_all(pairs: list[tuple["_Layer", list[Edges]]], *kinds: str) -> tuple[Array, ...]:
    return tuple(piece for layer, covers in pairs for line in layer.lines(*kinds) for piece in _cut(line, covers))


def _is_free(hazard: Hazard, covers: list[Edges]) -> bool:
    return bool(len(_outside(hazard.line[:1], covers)))


class _Layer:
    """One chart on the plane."""

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
        """Return places on contours, and on coasts, which are 0 m deep or dry as the area before them does: (n, 3)."""
        points = [
            np.column_stack([resample(line, self._apart), np.full(len(resample(line, self._apart)), depth)])
            for line, depth in self.contours()
        ]
        places = np.concatenate([np.empty((0, 3)), *points, *map(self._shallows, self.lines("COALNE"))])
        return np.asarray(places[first_in_cell(places, 0.5 * self._apart)])

    def strikes(self) -> Array:
        """Return the pieces of contours and coasts: their middles and vectors, (n, 4)."""
        lines = [*(line for line, _ in self.contours()), *self.lines("COALNE")]
        places = [resample(line, self._apart) for line in lines]
        pieces = [np.hstack([0.5 * (p[1:] + p[:-1]), np.diff(p, axis=0)]) for p in places]
        return np.concatenate([np.empty((0, 4)), *pieces])

    @cached_property
    def _apart(self) -> float:
        """Distance of guides from each other, m."""
        from scipy.spatial import cKDTree

        soundings = self.soundings()[:, :2]
        if len(soundings) < 2:
            return PAPER_APART * self._cell.scale
        nearest = cKDTree(soundings).query(soundings, 2)[0][:, 1]
        return max(GUIDES_APART * float(np.median(nearest)), DRAWN * self._cell.scale)

    def _shallows(self, coast: Array) -> Array:
        """Return places along a coast where a depth area borders on it, at 0 m or as the area dries: (n, 3)."""
        codes, depths = self._borders
        if not len(codes):
            return np.empty((0, 3))
        wanted = _codes(coast)
        at = np.minimum(np.searchsorted(codes, wanted), len(codes) - 1)
        depth = np.where(codes[at] == wanted, np.clip(depths[at], -MOST_BEACH, 0.0), np.nan)
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(coast, axis=0).T))])
        places = resample(coast, self._apart)
        found = np.interp(np.linspace(0.0, along[-1], len(places)), along, depth)
        return np.asarray(np.column_stack([places, found])[np.isfinite(found)])

    @cached_property
    def _borders(self) -> tuple[Codes, Array]:
        """Return the corners of all depth areas, sorted by their codes, and the least limit at each."""
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
            pipeline for feature in self._cell.select(*DIAMETERS)
            for pipeline in pipelines_of(feature, [p for edge in self._edges(feature) for p in _cut(edge, covers)])
        ]  # fmt: skip

    def zones(self) -> list[Zone]:
        detail = DRAWN * self._cell.scale
        return [
            zone for feature in self._cell.select(*ZONES) for zone in zones_of(feature, self._edges(feature), detail)
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
        return tuple(self._local(line) for line in feature.lines)

    def _local(self, positions: Array) -> Array:
        return np.column_stack(self._plane.to_local(positions[:, 1], positions[:, 0]))
