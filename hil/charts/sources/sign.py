"""Decide whether values are heights or depths: by what is stated, by their signs where all agree, never by guess.

And of which unit they are, and that they can be depths or heights of the earth at all.
"""

import re
from collections.abc import Iterable
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from hil.common.errors import ConfigError
from hil.common.text import clean

Positive = Literal["auto", "up", "down"]

_UP = {"elevation", "height", "altitude", "topo", "topography"}
_DOWN = {"depth", "sounding", "soundings"}
_NEUTRAL = {"bathymetry", "topobathy", "bathy", "z"}
_METRES = {"m": 1.0, "metre": 1.0, "meter": 1.0, "metres": 1.0, "meters": 1.0}
_OTHERS = {
    **dict.fromkeys(("ft", "foot", "feet", "us survey foot", "us-ft"), 0.3048),
    **dict.fromkeys(("fm", "fathom", "fathoms"), 1.8288), **dict.fromkeys(("cm", "centimeters", "centimetres"), 0.01),
    **dict.fromkeys(("km", "kilometers", "kilometres"), 1000.0), **dict.fromkeys(("mm",), 0.001),
    **dict.fromkeys(("dm", "decimeters", "decimetres"), 0.1),
}  # fmt: skip
_UNITS = {**_METRES, **_OTHERS}
FARTHEST = 12_000.0  # m from the sea's level: no place of the earth is
MARK = 9999.0  # m that stand for none in many a file that does not say so


def direction(path: str, positive: Positive, names: Iterable[str], low: float, high: float) -> tuple[bool, str]:
    """Return whether values between `low` and `high` m count upwards, as `positive` or their `names` say.

    Without such a name all of one sign are a seabed: below zero they are heights, above it depths; so they are where
    the name says depth and all are below zero. The second is a note on what was assumed so, "" where a name says it.
    Raises ConfigError where none of these decides.
    """
    if positive != "auto":
        return positive == "up", ""
    words = {word for name in names for word in _words(name)}
    if high <= 0.0 and low < 0.0:
        note = f"{path}: named as depths, taken as heights, as none is above zero (else --positive down)"
        return True, note if words & _DOWN and not words & _UP else ""
    if words & _UP:
        return True, ""
    if words & _DOWN:
        return False, ""
    if low >= 0.0:
        note = f"{path}: taken as depths, as none is below zero and no name says what they are (else --positive up)"
        return False, note
    raise ConfigError(
        f"{path}: values from {low:g} to {high:g} m, and nothing says whether they are heights or depths: say "
        "--positive up or --positive down"
    )


def is_of_depths(name: str) -> bool:
    """Return whether the name of a band says that depths or heights are in it, and not how sure they are."""
    words = _words(name)
    return bool(words & (_UP | _DOWN | _NEUTRAL)) and not words & {"uncertainty", "std", "stddev", "error", "sd"}


def metres_of(path: str, unit: str) -> float:
    """Return how long a unit of depth is, m. Raises ConfigError for one that is not known."""
    name = unit.strip().lower()
    found = _UNITS.get(name) or _UNITS.get(re.split(r"[^a-z]", name)[0])  # the latter of m above MSL
    if found is None:
        raise ConfigError(f"{path}: its depths are in {clean(unit, 30)!r}, which is none of {', '.join(_UNITS)}")
    return found


def metres_in(name: str) -> float:
    """Return how long the unit in the name of a column or band is, m, as feet of depth_ft; 1 if it names none."""
    return next((_OTHERS[word] for word in re.split(r"[^a-z]+", name.lower()) if word in _OTHERS), 1.0)


def require_possible(path: str, values: NDArray[np.float64]) -> None:
    """Raise ConfigError for depths or heights (m) that are nowhere on the earth, or are twice a mark for no depth."""
    sizes = np.abs(values)
    worst = float(sizes.max()) if len(values) else 0.0
    if worst > FARTHEST or (worst >= MARK and np.count_nonzero(sizes == (worst := MARK)) > 1):
        raise ConfigError(
            f"{path}: has {worst:g} m, which is no depth: if that stands for none, say so in the file, "
            "as gdal_translate -a_nodata does"
        )


def _words(name: str) -> set[str]:
    """Return the words of a name, as bed and elevation of bedElevation."""
    return set(re.split(r"[^a-z]+", re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower()))
