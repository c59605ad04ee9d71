"""Order sources by their priorities where they overlap.

- By default a raster has priority 1 and other sources 0; the user can set another priority for a file.
- Of overlapping rasters the one of the highest priority is used, of equal ones the first.
- Charts and soundings are combined into one surface. A raster below their highest priority is used only where they
  have no data.
- Of charts and soundings those of lower priority are left out where others have data: inside the coverage of a chart,
  and within the reach of single soundings.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from hil.autonomy.paths.polygons import contains
from hil.charts.sources.survey import Survey
from hil.common.errors import ConfigError

RASTER, OTHER = 1, 0


def require_named(priorities: Mapping[str, int], paths: Sequence[str]) -> None:
    """Raise ConfigError for a priority of a file that is not among `paths`."""
    for path in priorities:
        if path not in paths:
            raise ConfigError(f"--priority: {path} is not one of the files: {', '.join(paths)}")


def remove_outranked(parts: Sequence[Survey], ranks: Sequence[int]) -> list[Survey]:
    """Return the charts and soundings without their data where a survey of a higher rank has data."""
    remaining = []
    for part, rank in zip(parts, ranks, strict=True):
        above = [other for other, its in zip(parts, ranks, strict=True) if its > rank]
        if above:
            filtered = {
                key: rows[~_known(above, rows[:, :2])]
                for key in ("soundings", "guides", "strikes")
                if len(rows := getattr(part, key))
            }
            part = part._replace(**filtered)
        remaining.append(part)
    return remaining


def _known(surveys: Sequence[Survey], positions: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return the mask of the places (n, 2) where one of the surveys has data."""
    from scipy.spatial import KDTree

    known = np.zeros(len(positions), bool)
    for survey in surveys:
        for sheet in survey.sheets:
            known |= contains(sheet.coverage, positions)
        if survey.reach and len(survey.soundings):
            known |= KDTree(survey.soundings[:, :2]).query(positions, distance_upper_bound=survey.reach)[0] < np.inf
    return known
