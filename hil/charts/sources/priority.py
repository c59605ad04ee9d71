"""Order sources by their priorities where they overlap.

A raster has the priority 1 and all others 0, unless a person sets another for a file. Of rasters the one with the
greater priority is believed, of the same the first. Charts and soundings make one surface: a raster of less than the
greatest priority of these only fills in where they know nothing. Of charts and soundings those of less priority are
left out where others know the bed: in what a chart covers, and as far around single soundings as these reach.
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
            raise ConfigError(f"--priority: {path} is not among the files; there are: {', '.join(paths)}")


def without_outranked(parts: Sequence[Survey], ranks: Sequence[int]) -> list[Survey]:
    """Return the charts and soundings without what is known by those of a greater rank."""
    made = []
    for part, rank in zip(parts, ranks, strict=True):
        above = [other for other, its in zip(parts, ranks, strict=True) if its > rank]
        if above:
            kept = {
                key: rows[~_known(above, rows[:, :2])]
                for key in ("soundings", "guides", "strikes")
                if len(rows := getattr(part, key))
            }
            part = part._replace(**kept)
        made.append(part)
    return made


def _known(surveys: Sequence[Survey], places: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return at which places (n, 2) one of the surveys has the bed."""
    from scipy.spatial import KDTree

    known = np.zeros(len(places), bool)
    for survey in surveys:
        for sheet in survey.sheets:
            known |= contains(sheet.coverage, places)
        if survey.reach and len(survey.soundings):
            known |= KDTree(survey.soundings[:, :2]).query(places, distance_upper_bound=survey.reach)[0] < np.inf
    return known
