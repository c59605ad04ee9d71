"""Read S-57 charts (`.000`) with their updates (`.001`...): objects, attributes and geometry in degrees and metres.

GDAL reads them in a separate process with limits on memory and time (`hil.charts.sources.s57_process`), so a damaged
or hostile file can end only that process. An area is a set of rings, in any order, which may be holes: it is filled by
counting crossings. Not read: relations between objects, names in national languages, and data quality (CATZOC).
"""

import os
import re
from bisect import bisect_left
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.charts import limited
from hil.charts.sources.s57_process import DOES_NOT_FIT, REMEDY
from hil.common.errors import ConfigError
from hil.common.tables import check_file

MAX_BYTES = 64 << 20  # of a file; the ENC product specification allows 5 MB
# A chart of 5 MB takes a tenth of the memory, and 2 s
LIMITS = limited.Limits(memory=2 << 30, processor=30, seconds=120.0)
HEAD_BYTES = 1 << 16
# Denominators by the navigational purpose (IHO S-65 annex A); others as HARBOUR
USUAL_SCALES = {1: 1_500_000, 2: 350_000, 3: 90_000, 4: 22_000, 5: 12_000, 6: 4000}
HARBOUR = 5
# Scales at which displays hide objects (IHO S-65). Those of a chart begin one step above its own scale.
STEPS = (
    999, 1999, 2999, 3999, 7999, 11_999, 17_999, 21_999, 29_999, 44_999, 59_999, 89_999, 119_999, 179_999, 259_999,
    349_999, 499_999, 699_999, 999_999, 1_499_999, 2_999_999, 4_999_999, 9_999_999, 19_999_999,
)  # fmt: skip
COMMON = 0.02  # share of the objects that have a step: a rarer one may be damage
LEAST_STEPS = 3  # that a chart has in common use; one with fewer hides its objects by another rule
FINER = 4  # ratio of a purpose's usual scale to the largest that occurs
_DOWNLOAD_HINT = (
    "NOAA's charts are free at https://charts.noaa.gov/ENCs/ENCs.shtml: unpack one, and give the file in it that ends "
    "in .000"
)

Coordinates = NDArray[np.float64]


class Feature(NamedTuple):
    """One object of a chart.

    - `kind`: its object class, one of `s57_process.OBJECTS`.
    - `attributes`: numbers by name of the attribute.
    - `points`: (n, 3) longitude, latitude (degrees, WGS 84) and depth (m, nan if unknown).
    - `lines`: its lines, or the rings around its area, each (n, 2) longitude, latitude.
    - `is_area`: the lines bound an area.
    - `codes`: attributes that are lists of numbers, by name.
    - `name`: its name, "" if it has none.
    """

    kind: str
    attributes: dict[str, float]
    points: Coordinates
    lines: tuple[Coordinates, ...]
    is_area: bool
    codes: Mapping[str, Sequence[int]] = MappingProxyType({})
    name: str = ""

    def number(self, name: str) -> float | None:
        """Return an attribute; None if it is missing or empty."""
        return self.attributes.get(name)


class Cell(NamedTuple):
    """One chart: name, edition, number of the last update applied, denominator of the scale, and objects.

    `notes`: what was assumed, because the file does not state it, or states what the rest of it does not allow.
    """

    name: str
    edition: int
    update: int
    scale: int
    features: tuple[Feature, ...]
    notes: tuple[str, ...] = ()

    def select(self, *kinds: str) -> list[Feature]:
        """Return the objects of these classes."""
        return [feature for feature in self.features if feature.kind in kinds]


def read_cell(path: str, updates: bool = True) -> Cell:
    """Return the chart at `path`, with the updates beside it unless `updates` is false.

    Raises ConfigError; MissingExtraError without GDAL.
    """
    _check_kind(path, _head(path))
    try:
        head = limited.call("hil.charts.sources.s57_process:read_chart", path, updates, limits=LIMITS)
    except limited.EndedError as error:
        raise ConfigError(f"{path}: damaged or cut off (reading it {error}); copy it again") from None
    if head["units"] != [1, 1]:
        raise ConfigError(f"{path}: depths are not in metres or positions not in degrees, as in an ENC: convert it")
    for factor in head["factors"]:
        if str(factor).rstrip("0") != "1":
            raise ConfigError(f"{path}: positions and depths count in parts of {factor}, no power of ten: damaged")
    if updates:
        _check_updates(path, head["update"])
    features = tuple(Feature(*row) for row in head["features"])
    name = os.path.splitext(os.path.basename(path))[0]
    usual = USUAL_SCALES.get(head["purpose"], USUAL_SCALES[HARBOUR])
    scale, notes = max(head["scale"] or usual, _finest_scale(head["shown"], usual)), []
    if not head["scale"]:
        notes = [f"{path}: states no scale: read as 1:{scale}, the usual one of its purpose"]
    elif scale > head["scale"]:
        why = f"too large for its objects or purpose: read as 1:{scale}; --resolution sets a finer grid"
        notes = [f"{path}: states a scale of 1:{head['scale']}, {why}"]
    if head["unclosed"]:
        areas = ", ".join(f"{count} {kind}" for kind, count in head["unclosed"].items())
        notes.append(f"{path}: areas with edges that form no ring, closed by straight lines: {areas}")
    return Cell(name, head["edition"], head["update"], scale, features, tuple(notes))


def _finest_scale(shown: list[tuple[int, int]], usual: int) -> int:
    """Return the denominator of the largest scale that the data of a chart allow: damage may state a larger one.

    `shown`: scales at which displays hide its objects, and numbers of objects; `usual`: the scale of its purpose.
    """
    common = [scale for scale, count in shown if count >= COMMON * sum(count for _, count in shown)]
    if len(common) >= LEAST_STEPS:
        return STEPS[max(bisect_left(STEPS, common[0]) - 1, 0)] + 1
    return usual // FINER


def _head(path: str) -> bytes:
    if not os.path.exists(path):
        raise ConfigError(f"{path}: the chart cannot be read: No such file; {_DOWNLOAD_HINT}")
    check_file(path, MAX_BYTES)
    try:
        with open(path, "rb") as file:
            return file.read(HEAD_BYTES)
    except OSError as error:
        raise ConfigError(f"{path}: the chart cannot be read: {error.strerror}; copy it again") from None


def _check_kind(path: str, head: bytes) -> None:
    """Raise ConfigError if the first bytes are not those of an S-57 cell."""
    if len(head) < 24 or head[6:7] != b"L" or not head[:5].isdigit():
        raise ConfigError(
            f"{path}: not an ISO 8211 file, as a .000 chart is: it is compressed, a web page, or encrypted (S-63); "
            "unpack it, or use a chart that needs no permit"
        )
    if b"S-101" in head or b"S101" in head:
        raise ConfigError(f"{path}: a chart of the newer product S-101; use the S-57 edition of the same cell")


def _check_updates(path: str, applied: int) -> None:
    """Raise ConfigError if there are updates beside the cell after number `applied`, which were not applied."""
    stem, folder = os.path.basename(path)[:-4], os.path.dirname(path) or "."
    pattern = re.compile(re.escape(stem) + r"\.(\d{3})")
    later = {int(match[1]) for name in os.listdir(folder) if (match := pattern.fullmatch(name))}
    last = max(later, default=0)
    for number in range(applied + 1, last + 1):
        name = f"{path[:-4]}.{number:03d}"
        if number not in later:
            raise ConfigError(f"{name}: this update is missing, but there are later ones: {REMEDY}")
        raise ConfigError(f"{name}: {DOES_NOT_FIT}: {REMEDY}")
