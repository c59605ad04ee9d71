"""Compare a run in SIL with the run of the same seed in HIL.

Both use the same planner and the same files. In HIL the commands arrive with a delay that varies with the load of the
machine, so the same noise acts at other points of the motion.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hil.autonomy.paths.guide import distances_from_leg
from hil.autonomy.paths.occupancy import Point
from hil.cases.record import Result, Run, Track

# Figures of both runs: heading, value, format, format of their difference (relative if in per cent).
FIGURES: tuple[tuple[str, Callable[[Result], float], str, str], ...] = (
    ("length", lambda r: r.path_length, "{:.2f} m", "{:+.2%}"),
    ("time", lambda r: r.duration, "{:.2f} s", "{:+.2%}"),
    ("energy", lambda r: r.energy / 1e3, "{:.2f} kJ", "{:+.2%}"),
    ("least clearance", lambda r: r.least_clearance, "{:.3f} m", "{:+.3f} m"),
)


def compare(sil: Run, hil: Run) -> list[float]:
    """Return how far two runs of one case and seed differ, whose vehicles have the same order.

    The distances (m) of the HIL track's points from the SIL track, root mean square and greatest, of the vehicle with
    the largest; then the differences of `FIGURES`.
    """
    apart = [distances(there.points, here) for here, there in zip(sil.tracks, hil.tracks, strict=True)]
    found = [max(float(np.sqrt(np.mean(each * each))) for each in apart), max(float(each.max()) for each in apart)]
    for _, value, _, form in FIGURES:
        a, b = value(sil.result), value(hil.result)
        found.append(b / a - 1.0 if "%" in form else b - a)
    return found


def distances(points: Sequence[Point], track: Track) -> NDArray[np.float64]:
    """Return the distance (m) of each of `points` from the polyline of a track with at least two points."""
    places = np.array(points)
    legs = pairwise(track.points)
    nearest: NDArray[np.float64] = np.min([distances_from_leg(places, *leg) for leg in legs], axis=0)
    return nearest


def rows(sil: Run, hil: Run) -> list[list[str]]:
    """Return the rows of a table with SIL, HIL and their difference, column headings first."""
    rms, greatest, *differences = compare(sil, hil)
    table = [
        [f"seed {sil.result.seed}", "SIL", "HIL", "HIL against SIL"],
        ["distance between the paths, rms", "", "", f"{rms:.3f} m"],
        ["distance between the paths, greatest", "", "", f"{greatest:.3f} m"],
    ]
    for (name, value, form, difference), apart in zip(FIGURES, differences, strict=True):
        both = [form.format(value(run.result)) for run in (sil, hil)]
        table.append([name, *both, difference.format(apart)])
    return table
