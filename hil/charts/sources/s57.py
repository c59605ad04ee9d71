"""S-57 charts (`.000`) with their updates (`.001`...): objects, attributes and geometry in degrees and metres.

GDAL reads them, in a process of its own with limits on memory and time (`hil.charts.sources.s57_process`): a damaged or
hostile file ends that process and nothing else. Areas are left as the rings that bound them, holes among them: code
that fills them by counting crossings needs no order. Not read: relations between objects, names in national languages,
and how good the data are (CATZOC).
"""

import json
import os
import re
import subprocess
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.charts.sources.s57_process import NO_LIBRARY, UNFIT_UPDATE
from hil.common.children import finish_child, module_command
from hil.common.errors import ConfigError, MissingExtraError
from hil.common.tables import check_file
from hil.common.text import clean

MAX_BYTES = 64 << 20  # of a file; the ENC product specification allows 5 MB
MAX_SECONDS = 120  # for one chart; a large one takes 2 s
HEAD_BYTES = 1 << 16
_WHERE = (
    "NOAA's are free at https://charts.noaa.gov/ENCs/ENCs.shtml: unpack one, and name the file in it that ends in .000"
)
_WAY_OUT = "get the right file, or read the cell as it was issued with --no-updates"
_UNFIT = "does not fit the cell: of another edition, damaged, or it withdraws the chart"

Coordinates = NDArray[np.float64]


class Feature(NamedTuple):
    """One object of a chart.

    `kind` is its class (a name of `s57_process.OBJECTS`), `attributes` are the numbers that it has, by name; `points`
    (n, 3) longitude, latitude (degrees, WGS 84) and depth (m, nan if it has none), `lines` those it runs along or is
    bounded by, each (n, 2) longitude, latitude; `is_area` whether they bound an area; `codes` are attributes of several
    numbers, by name, and `name` is that of the object, if it has one.
    """

    kind: str
    attributes: dict[str, float]
    points: Coordinates
    lines: tuple[Coordinates, ...]
    is_area: bool
    codes: Mapping[str, Sequence[int]] = MappingProxyType({})
    name: str = ""

    def number(self, name: str) -> float | None:
        """Return an attribute; None if it is not there or left empty."""
        return self.attributes.get(name)


class Cell(NamedTuple):
    """One chart: its name, edition, the last update in it, the denominator of its scale, and its objects."""

    name: str
    edition: int
    update: int
    scale: int
    features: tuple[Feature, ...]

    def select(self, *kinds: str) -> list[Feature]:
        """Return the objects of these classes."""
        return [feature for feature in self.features if feature.kind in kinds]


def read_cell(path: str, updates: bool = True) -> Cell:
    """Return the chart at `path`, brought up to date by the updates beside it unless that is switched off.

    Raises ConfigError; MissingExtraError without GDAL.
    """
    _check_kind(path, _head(path))
    answer = _ask_process(path, updates)
    line, _, data = answer.partition(b"\n")
    head = json.loads(line)
    if head["units"] != [1, 1]:
        raise ConfigError(f"{path}: depths not in metres or positions not in degrees, which no ENC has: convert it")
    if updates:
        _check_updates(path, head["update"])
    features = _features(head["features"], np.frombuffer(data))
    name = os.path.splitext(os.path.basename(path))[0]
    return Cell(name, head["edition"], head["update"], head["scale"], features)


def _head(path: str) -> bytes:
    if not os.path.exists(path):
        raise ConfigError(f"{path}: the chart cannot be read: No such file; {_WHERE}")
    check_file(path, MAX_BYTES)
    try:
        with open(path, "rb") as file:
            return file.read(HEAD_BYTES)
    except OSError as error:
        raise ConfigError(f"{path}: the chart cannot be read: {error.strerror}; copy it again") from None


def _check_kind(path: str, head: bytes) -> None:
    """Refuse what is no S-57 cell by its first bytes, and say what it is where that shows. Raises ConfigError."""
    if len(head) < 24 or head[6:7] != b"L" or not head[:5].isdigit():
        raise ConfigError(
            f"{path}: not an ISO 8211 file, which a .000 chart is: it is packed, a web page, or encrypted (S-63); "
            "unpack it, or take a chart that needs no permit"
        )
    if b"S-101" in head or b"S101" in head:
        raise ConfigError(f"{path}: a chart of the newer product S-101; take the S-57 edition of the same cell")


def _ask_process(path: str, updates: bool) -> bytes:
    """Return what `hil.charts.sources.s57_process` reads in the file. Raises ConfigError, MissingExtraError."""
    command = module_command("hil.charts.sources.s57_process", path, "APPLY" if updates else "IGNORE")
    try:
        done = finish_child(command, MAX_SECONDS)
    except subprocess.TimeoutExpired:
        raise ConfigError(f"{path}: not read within {MAX_SECONDS} s: damaged; copy it again") from None
    code = done.returncode
    if code == 0:
        return done.stdout
    reason = done.stderr.decode(errors="replace").strip().splitlines()[-1:] or [f"exit code {code}"]
    if code == NO_LIBRARY:
        raise MissingExtraError("charts need GDAL: pip install 'uuv-hil[chart]'")
    if code == UNFIT_UPDATE:
        raise ConfigError(f"{path}: an update beside it {_UNFIT} ({clean(reason[0].strip())}): {_WAY_OUT}")
    if code < 0:  # by a signal: at a limit on memory or time, or GDAL itself fell
        reason = [f"reading it ended with signal {-code}"]
    raise ConfigError(f"{path}: damaged or cut off ({clean(reason[0])}); copy it again")


def _check_updates(path: str, applied: int) -> None:
    """Check that no update after `applied` lies beside the cell and none before it is missing. Raises ConfigError."""
    stem, folder = os.path.basename(path)[:-4], os.path.dirname(path) or "."
    pattern = re.compile(re.escape(stem) + r"\.(\d{3})")
    later = {int(match[1]) for name in os.listdir(folder) if (match := pattern.fullmatch(name))}
    last = max(later, default=0)
    for number in range(applied + 1, last + 1):
        name = f"{path[:-4]}.{number:03d}"
        if number not in later:
            raise ConfigError(f"{name}: no such update, but there are later ones: {_WAY_OUT}")
        raise ConfigError(f"{name}: {_UNFIT}: {_WAY_OUT}")


def _features(rows: list[dict[str, Any]], numbers: Coordinates) -> tuple[Feature, ...]:
    """Return the objects: their points, then their lines, lie one after another in `numbers`."""
    features, at = [], 0
    for row in rows:
        size = 3 * row["points"]
        points, at = numbers[at : at + size].reshape(-1, 3), at + size
        lines = []
        for count in row["lines"]:
            lines.append(numbers[at : at + 2 * count].reshape(-1, 2))
            at += 2 * count
        features.append(
            Feature(
                row["kind"], row["attributes"], points, tuple(lines), row["is_area"], row["codes"], clean(row["name"])
            )
        )
    return tuple(features)
