"""S-57 charts (`.000`) with their updates (`.001`...): objects, attributes and geometry in degrees and metres.

Written after IHO S-57 edition 3.1, part 3, and its annex B (ENC product specification). Areas are left as the
edges that bound them, holes among them: whoever fills them by counting crossings needs no rings.
Not read: relations between objects, names in national languages, and how good the data are (CATZOC).
"""

import os
import re
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.charts.iso8211 import Record, Row, read_records
from hil.errors import ConfigError

# Object classes that shape a seabed or stand on it, and their attributes (S-57 appendix A).
OBJECTS = {
    11: "BRIDGE", 26: "CAUSWY", 30: "COALNE", 38: "DAMCON", 42: "DEPARE", 43: "DEPCNT", 46: "DRGARE", 57: "FLODOC",
    65: "HULKES", 71: "LNDARE", 84: "MORFAC", 86: "OBSTRN", 90: "PILPNT", 95: "PONTON", 98: "PYLONS", 122: "SLCONS",
    129: "SOUNDG", 153: "UWTROC", 154: "UNSARE", 159: "WRECKS", 302: "M_COVR",
}  # fmt: skip
ATTRIBUTES = {
    18: "CATCOV", 87: "DRVAL1", 88: "DRVAL2", 116: "OBJNAM", 174: "VALDCO", 179: "VALSOU", 181: "VERCLR", 187: "WATLEV",
}  # fmt: skip
_DELETED = "\x7f"  # an update's way to take an attribute away
_WHERE = (
    "NOAA's are free at https://charts.noaa.gov/ENCs/ENCs.shtml: unpack one, and name the file in it that ends in .000"
)
_WAY_OUT = "get the missing file, or read the cell as it was issued with --no-updates"

# Which numbers of the head (DSSI) count the records of a kind: features, isolated and connected nodes, edges
_COUNTS = {100: ("NOMR", "NOCR", "NOGR", "NOLR"), 110: ("NOIN",), 120: ("NOCN",), 130: ("NOED",)}

Name = tuple[int, int]  # kind of record and its number
Coordinates = NDArray[np.float64]


class Feature(NamedTuple):
    """One object of a chart.

    `kind` is its class (a name of OBJECTS), `attributes` their text by name, `points` (n, 3) longitude, latitude
    (degrees, WGS 84) and depth (m, nan if it has none), `lines` the edges it runs along or is bounded by, each (n, 2)
    longitude, latitude; `is_area` whether they bound an area.
    """

    kind: str
    attributes: dict[str, str]
    points: Coordinates
    lines: tuple[Coordinates, ...]
    is_area: bool

    def number(self, name: str) -> float | None:
        """An attribute as a number; None if it is not there or left empty."""
        text = self.attributes.get(name, "")
        return float(text) if text else None


class Cell(NamedTuple):
    """One chart: its name, edition, the last update in it, the denominator of its scale, and its objects."""

    name: str
    edition: int
    update: int
    scale: int
    features: tuple[Feature, ...]

    def select(self, *kinds: str) -> list[Feature]:
        """The objects of these classes."""
        return [feature for feature in self.features if feature.kind in kinds]


def read_cell(path: str, updates: bool = True) -> Cell:
    """The chart at `path`, brought up to date by the updates beside it unless told not to. Raises ConfigError."""
    try:
        return _read_cell(path, updates)
    except (LookupError, ValueError, TypeError, ArithmeticError) as error:  # bytes that read, but make no sense
        raise ConfigError(f"{path}: damaged, it or an update ({error!r}); copy it again") from None


def _read_cell(path: str, updates: bool) -> Cell:
    table: dict[Name, Record] = {}
    head = _read(path, table)
    edition, update = int(head["EDTN"]), int(head["UPDN"] or 0)
    scale = _check_units(table, path)
    if updates:
        for number in _updates(path, update):
            _update(f"{path[:-4]}.{number:03d}", table, edition, number)
            update = number
    name = os.path.splitext(os.path.basename(path))[0]
    return Cell(name, edition, update, scale, tuple(_features(table)))


def _read(path: str, table: dict[Name, Record]) -> Row:
    """Put the records of a base cell into `table`; its DSID row."""
    head: Row | None = None
    for record in read_records(_bytes(path), path, skip=("NATF",)):
        if "DSID" in record:
            head = {**record["DSID"][0], **record.get("DSSI", [{}])[0]}
        elif (name := _name(record)) is not None:
            table[name] = record
    if head is None or "DSPM" not in _tags(table):
        raise ConfigError(f"{path}: no S-57 cell: it names no data set (DSID) or no scale and units (DSPM)")
    for kind, counts in _COUNTS.items():
        there, said = sum(name[0] == kind for name in table), sum(head.get(count, 0) for count in counts)
        if there < said:
            raise ConfigError(f"{path}: cut off: its head tells of {said} records of kind {kind}, {there} are there")
    return head


def _bytes(path: str) -> bytes:
    try:
        with open(path, "rb") as file:
            return file.read()
    except FileNotFoundError:
        raise ConfigError(f"{path}: the chart cannot be read: No such file; {_WHERE}") from None
    except OSError as error:
        raise ConfigError(f"{path}: the chart cannot be read: {error.strerror}; copy it again") from None


def _tags(table: dict[Name, Record]) -> set[str]:
    return {tag for record in table.values() for tag in record}


def _name(record: Record) -> Name | None:
    for tag in ("FRID", "VRID", "DSPM"):
        if tag in record:
            return record[tag][0]["RCNM"], record[tag][0]["RCID"]
    return None


def _parameters(table: dict[Name, Record]) -> Row:
    return next(record["DSPM"][0] for record in table.values() if "DSPM" in record)


def _check_units(table: dict[Name, Record], path: str) -> int:
    parameters = _parameters(table)
    if parameters["DUNI"] != 1 or parameters["COUN"] != 1:
        raise ConfigError(f"{path}: depths not in metres or positions not in degrees, which no ENC has: convert it")
    return int(parameters["CSCL"])


def _updates(path: str, base: int) -> range:
    """The numbers of the updates beside `path` that come after number `base`. Raises ConfigError for a gap."""
    stem, folder = os.path.basename(path)[:-4], os.path.dirname(path) or "."
    pattern = re.compile(re.escape(stem) + r"\.(\d{3})")
    found = {int(match[1]) for name in os.listdir(folder) if (match := pattern.fullmatch(name))}
    later = {number for number in found if number > base}
    for number in range(base + 1, max(later, default=base) + 1):
        if number not in later:
            raise ConfigError(f"{path[:-4]}.{number:03d}: no such update, but there are later ones: {_WAY_OUT}")
    return range(base + 1, base + 1 + len(later))


def _update(path: str, table: dict[Name, Record], edition: int, number: int) -> None:
    """Apply the update file at `path` to `table`. Raises ConfigError if it does not fit."""
    for record in read_records(_bytes(path), path, skip=("NATF",)):
        if "DSID" in record:
            head = record["DSID"][0]
            if int(head["EDTN"]) == 0:
                raise ConfigError(f"{path}: withdraws the chart: take its successor, or --no-updates")
            if (int(head["EDTN"]), int(head["UPDN"])) != (edition, number):
                raise ConfigError(
                    f"{path}: is update {head['UPDN']} of edition {head['EDTN']}, not {number} of {edition}: {_WAY_OUT}"
                )
        elif "DSPM" not in record and (name := _name(record)) is not None:
            _change(table, name, record, path)


def _change(table: dict[Name, Record], name: Name, record: Record, path: str) -> None:
    head = (record.get("FRID") or record["VRID"])[0]
    instruction = head["RUIN"]
    if instruction == 1:
        table[name] = record
        return
    old = table.get(name)
    if old is None or (old.get("FRID") or old["VRID"])[0]["RVER"] != head["RVER"] - 1:
        raise ConfigError(f"{path}: changes record {name}, which is not there in the version it expects: {_WAY_OUT}")
    if instruction == 2:
        del table[name]
        return
    (old.get("FRID") or old["VRID"])[0]["RVER"] = head["RVER"]
    for tag in ("ATTF", "ATTV"):
        if tag in record:
            merged = {row["ATTL"]: row for row in (*old.get(tag, ()), *record[tag])}
            old[tag] = [row for row in merged.values() if row["ATVL"] != _DELETED]
    for control, tags in (("FSPC", ("FSPT",)), ("VRPC", ("VRPT",)), ("SGCC", ("SG2D", "SG3D"))):
        if control in record:
            tag = next((tag for tag in tags if tag in record or tag in old), tags[0])
            _splice(old.setdefault(tag, []), record[control][0], record.get(tag, []))


def _splice(rows: list[Row], control: Row, new: list[Row]) -> None:
    """Insert, delete or replace rows as a control field says: instruction, first row counted from 1, how many."""
    instruction, index, count = control.values()
    start = index - 1
    rows[start : start + (0 if instruction == 1 else count)] = [] if instruction == 2 else new


def _features(table: dict[Name, Record]) -> list[Feature]:
    parameters = _parameters(table)
    shapes = _Shapes(table, parameters["COMF"], parameters["SOMF"])
    kept = [record for record in table.values() if "FRID" in record and record["FRID"][0]["OBJL"] in OBJECTS]
    return [_feature(record, shapes) for record in kept]


def _feature(record: Record, shapes: "_Shapes") -> Feature:
    head = record["FRID"][0]
    known = {ATTRIBUTES[row["ATTL"]]: row["ATVL"] for row in record.get("ATTF", ()) if row["ATTL"] in ATTRIBUTES}
    pointers = [(_pointer(row), row["ORNT"] == 2) for row in record.get("FSPT", ())]
    lines = tuple(shapes.edge(name, backwards) for name, backwards in pointers if name[0] == 130)
    nodes = [shapes.node(name) for name, _ in pointers if name[0] != 130]
    points = np.concatenate(nodes) if nodes else np.empty((0, 3))
    return Feature(OBJECTS[head["OBJL"]], known, points, lines, head["PRIM"] == 3)


class _Shapes:
    """Nodes and edges in degrees and metres, by name."""

    def __init__(self, table: dict[Name, Record], per_degree: float, per_metre: float) -> None:
        self._table, self._per_degree, self._per_metre = table, per_degree, per_metre

    def node(self, name: Name) -> Coordinates:
        """(n, 3): one point without a depth, or many soundings."""
        record = self._table[name]
        if "SG3D" in record:
            rows: Any = [(row["XCOO"], row["YCOO"], row["VE3D"]) for row in record["SG3D"]]
            return np.array(rows, float) / (self._per_degree, self._per_degree, self._per_metre)
        return np.column_stack([self._plane(record["SG2D"]), np.full(len(record["SG2D"]), np.nan)])

    def edge(self, name: Name, backwards: bool) -> Coordinates:
        """(n, 2) from its first node to its last, or the other way."""
        record = self._table[name]
        ends = {row["TOPI"]: self._table[_pointer(row)]["SG2D"] for row in record["VRPT"]}
        line = self._plane([*ends[1], *record.get("SG2D", ()), *ends[2]])
        return line[::-1] if backwards else line

    def _plane(self, rows: list[Row]) -> Coordinates:
        return np.array([(row["XCOO"], row["YCOO"]) for row in rows], float) / self._per_degree


def _pointer(row: Row) -> Name:
    name: bytes = row["NAME"]
    return name[0], int.from_bytes(name[1:], "little")
