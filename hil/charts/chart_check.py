"""Refuse charts whose positions, depths or scale contradict each other: damage that would take all memory to grid.

A byte changed in a position moves it by up to hundreds of degrees, and one in the header changes the scale. The length
of contours and the number of nodes follow from both. So they are compared with the rest of the chart before anything is
made of them.
"""

import numpy as np
from numpy.typing import NDArray

from hil.charts.sources.s57 import Cell, Feature
from hil.common.errors import ConfigError

Array = NDArray[np.float64]

DEEPEST, HIGHEST = 12_000.0, -9_000.0  # m
DRAWN = ("DEPCNT", "COALNE")  # lines along which the bed is interpolated
DEPTHS = ("DRVAL1", "DRVAL2", "VALDCO", "VALSOU")
MARGIN = 1.0  # how far outside the coverage objects may reach, as a multiple of its size; 0.1 occurs in sound charts
ISOLATED = 0.4  # greatest part of a coverage's height or width which only one of the chart's positions spans
# Size of the coverage on paper, m. A sheet is 1 m wide, and a cell of a river ten times as long.
SMALLEST, LARGEST = 0.002, 30.0
# A corner of a contour or coast, off by so much of the coverage on a line that returns to where it left, is damage.
SPIKE = 0.1
METRES_PER_DEGREE = 111_200.0


def check_chart(cell: Cell, coverage: list[Feature]) -> None:
    """Raise ConfigError if `cell` is damaged; `coverage`: the objects that state which area it covers."""
    covered = _positions(coverage)
    middle = float(np.median(covered[:, 0]))
    covered = _turned(covered, middle)
    everything = _turned(_positions(cell.features), middle)
    if not np.isfinite(everything).all() or np.abs(everything[:, 1]).max() > 90.0:
        raise _damaged(cell, "has positions that are not on the earth")
    low, high = covered.min(axis=0), covered.max(axis=0)
    for axis, name in enumerate(("longitude", "latitude")):
        values = np.unique(everything, axis=0)[:, axis]
        for edge, sign in ((low[axis], 1.0), (high[axis], -1.0)):
            inner = np.sort(sign * values[sign * values >= sign * edge])[:2]
            if len(inner) == 2 and inner[1] - inner[0] > ISOLATED * (high[axis] - low[axis]):
                raise _damaged(cell, f"one corner of its coverage, at {name} {edge:.4f}, is far from all other objects")
    margin, longer = MARGIN * (high - low), float((high - low).max())
    for feature in cell.features:
        if feature.is_area and not feature.lines:
            raise _damaged(cell, f"an area {feature.kind} has no edges")
        places = _turned(_positions([feature]), middle)
        outside = places[((places < low - margin) | (places > high + margin)).any(axis=1)]
        if len(outside):
            place = f"{outside[0, 1]:.4f} N, {(outside[0, 0] + 180.0) % 360.0 - 180.0:.4f} E"
            raise _damaged(cell, f"an object {feature.kind} reaches to {place}, far outside of its coverage")
        if any(_has_spike(_turned(line, middle) / longer) for line in feature.lines if feature.kind in DRAWN):
            raise _damaged(cell, f"an object {feature.kind} has a corner far from its neighbours")
    _check_depths(cell)
    size = longer * METRES_PER_DEGREE
    if not SMALLEST <= size / cell.scale <= LARGEST:
        raise _damaged(cell, f"states a scale of 1:{cell.scale}, but covers {0.001 * size:.3g} km")


def _has_spike(line: Array) -> bool:
    """Return whether one corner of `line` (n, 2; shares of the coverage's longer side) is far from its neighbours."""
    sides = np.diff(line, axis=0)
    away = np.minimum(np.hypot(*sides[1:].T), np.hypot(*sides[:-1].T))
    return bool(((away > SPIKE) & (np.hypot(*(sides[1:] + sides[:-1]).T) < 0.5 * away)).any())


def _check_depths(cell: Cell) -> None:
    for feature in cell.features:
        known = [feature.attributes[name] for name in DEPTHS if name in feature.attributes]
        if feature.kind == "SOUNDG":
            known += feature.points[:, 2].tolist()
        for depth in known:
            if not HIGHEST <= depth <= DEEPEST:
                raise _damaged(cell, f"an object {feature.kind} has a depth of {depth:g} m")


def _damaged(cell: Cell, what: str) -> ConfigError:
    return ConfigError(f"{cell.name}: {what}: the chart is damaged; copy it again")


def _positions(features: list[Feature] | tuple[Feature, ...]) -> Array:
    """Return longitude and latitude of all corners and points, (n, 2)."""
    parts = [part for feature in features for part in (*feature.lines, feature.points[:, :2])]
    return np.concatenate([np.empty((0, 2)), *parts])


def _turned(places: Array, middle: float) -> Array:
    """Return `places` with longitudes within half a turn of `middle`: a chart may be on both sides of 180 degrees."""
    return np.column_stack([middle + (places[:, 0] - middle + 180.0) % 360.0 - 180.0, places[:, 1]])
