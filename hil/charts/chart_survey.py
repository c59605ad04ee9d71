"""Combine charts on one plane: where they overlap, the larger scale is used."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.charts.hazards import hazards_of
from hil.charts.polygons import Edges, contains
from hil.charts.projection import LocalPlane
from hil.charts.sources.s57 import Cell, Feature
from hil.charts.sources.survey import DepthArea, Hazard, Sheet, Survey, resample
from hil.common.errors import ConfigError

Array = NDArray[np.float64]

# Contours are sampled as finely as the grid resolves and the chart draws: 2 mm on paper.
STEP_NODES = 2.5
STEP_PAPER = 0.002


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
    return Box(*corners.min(axis=0)[::-1].tolist(), *corners.max(axis=0)[::-1].tolist())


def survey_charts(cells: list[Cell], plane: LocalPlane, resolution: float) -> Survey:
    """Return what `cells` say, on `plane`; contours sampled for a grid of `resolution` m. Raises ConfigError."""
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
        guides=np.concatenate([_outside(layer.guides(resolution), covers) for layer, covers in pairs]),
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
    )


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

    def guides(self, resolution: float) -> Array:
        step = max(STEP_NODES * resolution, STEP_PAPER * self._cell.scale)
        lines = [(resample(line, step), depth) for line, depth in self.contours()]
        points = [np.column_stack([line, np.full(len(line), depth)]) for line, depth in lines]
        return np.concatenate([np.empty((0, 3)), *points])

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
