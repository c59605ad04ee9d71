"""Compare a run in SIL with the run of the same seed in HIL.

Both use the same planner and the same files. In HIL the commands arrive with a delay that varies with the load of the
machine, so the same noise acts at other points of the motion.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.autonomy.paths.guide import distances_from_leg
from hil.autonomy.paths.occupancy import Point
from hil.cases.record import Run, Track


class Fidelity(NamedTuple):
    """Differences of HIL from SIL.

    `path_rms`, `path_max`: distances (m) of the HIL track's points from the SIL track, of the vehicle with the largest.
    `length`, `time`, `energy`: relative differences. `clearance`: least clearance in HIL minus that in SIL, m.
    """

    path_rms: float
    path_max: float
    length: float
    time: float
    energy: float
    clearance: float


def compare(sil: Run, hil: Run) -> Fidelity:
    """Compare two runs of one case and seed, whose vehicles have the same order."""
    apart = [distances(there.points, here) for here, there in zip(sil.tracks, hil.tracks, strict=True)]
    a, b = sil.result, hil.result
    return Fidelity(
        max(float(np.sqrt(np.mean(each * each))) for each in apart),
        max(float(each.max()) for each in apart),
        b.path_length / a.path_length - 1.0,
        b.duration / a.duration - 1.0,
        b.energy / a.energy - 1.0,
        b.least_clearance - a.least_clearance,
    )


def distances(points: Sequence[Point], track: Track) -> NDArray[np.float64]:
    """Return the distance (m) of each of `points` from the polyline of a track with at least two points."""
    places = np.array(points)
    legs = pairwise(track.points)
    nearest: NDArray[np.float64] = np.min([distances_from_leg(places, *leg) for leg in legs], axis=0)
    return nearest


ROWS = (
    ("distance between the paths, rms", "{:.3f} m"),
    ("distance between the paths, greatest", "{:.3f} m"),
    ("length", "{:+.2%}"),
    ("time", "{:+.2%}"),
    ("energy", "{:+.2%}"),
    ("least clearance", "{:+.3f} m"),
)


def rows(sil: Run, hil: Run) -> list[list[str]]:
    """Return the rows of a table with SIL, HIL and their difference, column headings first."""
    differences = compare(sil, hil)
    a, b = sil.result, hil.result
    both = {
        "length": (f"{a.path_length:.2f} m", f"{b.path_length:.2f} m"),
        "time": (f"{a.duration:.2f} s", f"{b.duration:.2f} s"),
        "energy": (f"{a.energy / 1e3:.2f} kJ", f"{b.energy / 1e3:.2f} kJ"),
        "least clearance": (f"{a.least_clearance:.3f} m", f"{b.least_clearance:.3f} m"),
    }
    head = [f"seed {a.seed}", "SIL", "HIL", "HIL against SIL"]
    return [
        head,
        *(
            [name, *both.get(name, ("", "")), form.format(value)]
            for (name, form), value in zip(ROWS, differences, strict=True)
        ),
    ]
