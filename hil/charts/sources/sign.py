"""Decide whether values are heights or depths, find their unit, and check that they are possible on the earth.

Options, names, or signs that all values share distinguish heights from depths; there is no guess.
"""

import re
from collections.abc import Iterable
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.common.errors import ConfigError
from hil.common.text import clean

Positive = Literal["auto", "up", "down"]

_UP = {"elevation", "height", "altitude", "topo", "topography", "dem", "dtm"}
_DOWN = {"depth", "sounding", "soundings"}
_SEABED = {"bathymetry", "bathymetric", "topobathy", "bathy"}
_NEUTRAL = {*_SEABED, "z"}
# Words of what is said about a depth, and is none
_ABOUT = {"uncertainty", "std", "stddev", "error", "sd", "sigma", "count", "counts", "flag", "quality", "mask", "index"}
UNITS = {
    **dict.fromkeys(("m", "metre", "meter", "metres", "meters"), 1.0), **dict.fromkeys(("ft", "foot", "feet"), 0.3048),
    **dict.fromkeys(("us-ft", "us survey foot", "us survey feet", "us_survey_foot", "usft", "ftus"), 1200.0 / 3937.0),
    **dict.fromkeys(("fm", "fathom", "fathoms"), 1.8288), **dict.fromkeys(("cm", "centimeters", "centimetres"), 0.01),
    **dict.fromkeys(("km", "kilometers", "kilometres"), 1000.0), **dict.fromkeys(("mm",), 0.001),
    **dict.fromkeys(("dm", "decimeters", "decimetres"), 0.1),
}  # fmt: skip
MAX_MAGNITUDE = 12_000.0  # m above or below sea level: more than any place on the earth
MAX_DRYING = 50.0  # m of land above the water in data that are named as depths
NO_DATA_MARK = 9999.0  # m: in many files this means "no value" although they do not state it


class Declared(NamedTuple):
    """What the user says of files that do not say it themselves.

    - `positive`: whether values count "up" or "down", "auto" to detect it.
    - `crs`: coordinate system of files that state none, for example EPSG:32605.
    - `unit`: of the depths, one of UNITS.
    - `layer`: the variable, band or column with the depths, as NAME, NUMBER or NAME:NUMBER. A number, from 1, selects a
      band, or of a variable with several times one of them.
    """

    positive: Positive = "auto"
    crs: str | None = None
    unit: str | None = None
    layer: str | None = None

    def split_layer(self) -> tuple[str, int]:
        """Return name and number of `layer`; "" and 0 for what it has not."""
        name, _, number = (self.layer or "").rpartition(":")
        return (name, int(number)) if number.isdigit() else (self.layer or "", 0)


def detect_direction(
    path: str, positive: Positive, names: Iterable[str], low: float, high: float, axis: str = ""
) -> tuple[bool, str]:
    """Return whether values between `low` and `high` m count upwards (heights), and a note on what was assumed.

    `positive` decides, else `names` (of a band or column), else the name of a vertical `axis`, else the signs: values
    that are all below zero are heights, even if named as depths, and those of a bathymetry that are all above zero are
    depths. Without such a name these may be heights of land as well. The note is "" if nothing was assumed. Raises
    ConfigError if none of these decides.
    """
    if positive != "auto":
        return positive == "up", ""
    words = {word for name in names for word in _words(name)}
    if axis and not words & (_UP | _DOWN):
        words = {axis}
    if high <= 0.0 and low < 0.0:
        note = f"{path}: named as depths, read as heights, because none is above zero (else use --positive down)"
        return True, note if words & _DOWN and not words & _UP else ""
    if words & _UP:
        return True, ""
    if words & _DOWN and -low > max(high, MAX_DRYING):
        raise ConfigError(
            f"{path}: named as depths, but values from {low:g} to {high:g} m would be more land than water: use "
            "--positive down if that is so, --positive up if they are heights"
        )
    if words & _DOWN:
        return False, ""
    if low >= 0.0 and words & _SEABED:
        note = f"{path}: read as depths, because none is below zero and no name states it (land heights: --positive up)"
        return False, note
    raise ConfigError(
        f"{path}: values from {low:g} to {high:g} m, and nothing states whether they are heights or depths: use "
        "--positive up or --positive down"
    )


def first_hint(*groups: Iterable[str | None]) -> list[str]:
    """Return the texts of the first group, from the strongest, with a word of heights, depths or the seabed."""
    listed = [[text for text in group if text] for group in groups]
    return next((texts for texts in listed if any(_words(text) & (_UP | _DOWN | _SEABED) for text in texts)), [])


def join_notes(*notes: str) -> str:
    """Return notes as one text; "" for none."""
    return "; ".join(filter(None, notes))


def is_depth_name(name: str) -> bool:
    """Return whether a band with this name contains depths or heights, and not their uncertainty."""
    words = _words(name)
    return bool(words & (_UP | _DOWN | _NEUTRAL)) and not words & _ABOUT


def metres_per_unit(path: str, unit: str) -> float:
    """Return the length of a unit of depth in m. Raises ConfigError for an unknown unit."""
    name = unit.strip().lower()
    found = UNITS.get(name) or UNITS.get(re.split(r"[^a-z]", name)[0])  # the second for "m above MSL"
    if found is None:
        raise ConfigError(f"{path}: its depths are in {clean(unit, 30)!r}; known units: {', '.join(UNITS)}")
    return found


def unit_in_name(name: str) -> str:
    """Return the unit in the name of a column or band, for example ft of depth_ft; "" if it has none."""
    words = re.split(r"[^a-z]+", name.lower())
    unit = next((word for word in words[1:] if word in UNITS), "")
    return "us-ft" if unit in ("ft", "foot", "feet") and "us" in words else unit


def require_possible(path: str, values: NDArray[np.float64]) -> None:
    """Raise ConfigError for depths or heights (m) that no place on the earth has, or if NO_DATA_MARK occurs twice."""
    magnitudes = np.abs(values)
    worst = float(magnitudes.max()) if len(values) else 0.0
    if worst > MAX_MAGNITUDE or (worst >= NO_DATA_MARK and np.count_nonzero(magnitudes == (worst := NO_DATA_MARK)) > 1):
        raise ConfigError(
            f"{path}: has values of {worst:g} m, which cannot be depths: if they mean no data, mark them in the file, "
            "for example with gdal_translate -a_nodata"
        )


def _words(name: str) -> set[str]:
    """Return the words of a name in lower case: bed and elevation of bedElevation."""
    return set(re.split(r"[^a-z]+", re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower()))
