"""Compare runs of one seed in SIL and in HIL: how far they differ.

Both fly the same planner and the same files. What differs: in HIL the commands come late and at times of the machine's
own choosing, so that noise and motion do not meet in the same steps.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.autonomy.paths.occupancy import Point
from hil.cases.record import Run, Track


class Fidelity(NamedTuple):
    """HIL against SIL. Lengths in m, time in s; `length`, `time` and `energy` as shares of SIL's.

    `path_*` are how far the places of the HIL track are from the SIL track, wherever on it, of the vehicle for which
    that is worst; `clearance` is HIL's least minus SIL's.
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
    """Return the distance (m) of each of `points` from the polyline of a track of two places or more."""
    places = np.array(track.points)
    starts, legs = places[:-1], np.diff(places, axis=0)
    squares = np.maximum(np.sum(legs * legs, axis=1), 1e-12)  # where it stood still
    nearest = np.empty(len(points))
    for number, point in enumerate(points):
        shares = np.clip(np.sum((point - starts) * legs, axis=1) / squares, 0.0, 1.0)
        nearest[number] = np.min(np.linalg.norm(point - starts - shares[:, None] * legs, axis=1))
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
    """Return rows for a report: SIL, HIL and the difference, the heads of the columns first."""
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
