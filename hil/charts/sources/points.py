"""Read soundings from XYZ and CSV files, also compressed ones, and from point clouds."""

import bz2
import csv
import gzip
import lzma
import os
import zlib
from array import array
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import chain
from typing import IO, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.charts.sources import las
from hil.charts.sources.sign import (
    Declared,
    detect_direction,
    first_hint,
    is_depth_name,
    join_notes,
    require_possible,
    unit_in_name,
)
from hil.charts.sources.systems import WGS84, depth_unit, parse_crs, vertical_axis
from hil.common.errors import ConfigError
from hil.common.tables import check_file
from hil.common.text import clean

Array = NDArray[np.float64]

# Names of columns (lower case, up to the first bracket or underscore)
_LONGITUDE, _LATITUDE = {"lon", "long", "longitude", "lng"}, {"lat", "latitude"}
_EAST, _NORTH = {"e", "east", "easting", "x"}, {"n", "north", "northing", "y"}
_DEPTH = {"z", "depth", "bathymetry", "elevation", "height", "altitude", "sounding", "bottom", "topo"}
LARGEST = 1 << 30  # bytes of a file, and characters of its uncompressed text
MAX_LINES = 20_000_000  # of one file; a sounding takes 24 bytes
LONGEST_LINE = 10_000  # characters
MAX_REPEATED = 0.05  # share of places with several depths, above which a note says so
MAX_DISTANCE = 1e5  # m from the origin of a world
SPOT = 2.0  # m: positions in so small an area are degrees, if their numbers could be
COMMENTS = ("#", "%", ">", "!", "//")  # of GMT, MATLAB, Surfer and others
COMPRESSED: dict[str, Callable[..., IO[str]]] = {".gz": gzip.open, ".xz": lzma.open, ".bz2": bz2.open}
ENDINGS = (".xyz", ".csv", ".txt", ".tsv", ".dat")


class Points(NamedTuple):
    """Soundings. `positions`: (n, 2) latitude, longitude in degrees if `geographic`, else north, east in m.

    `depths`: (n,) m, positive down. `note`: what was assumed when reading, "" for nothing.
    """

    name: str
    positions: Array
    depths: Array
    geographic: bool
    note: str = ""


def is_points(path: str) -> bool:
    """Return whether the ending of a file's name is that of soundings."""
    stem, ending = os.path.splitext(path.lower())
    return (os.path.splitext(stem)[1] if ending in COMPRESSED else ending) in (*ENDINGS, *las.ENDINGS)


# Rows of east (longitude), north (latitude) and depth as a file has them; whether the first two are degrees; their
# coordinate system, None if not known; name and unit of the depths, "" for none; a note
_Table = tuple[Array, bool, Any, str, str, str]


def read_points(path: str, declared: Declared = Declared()) -> Points:
    """Return the soundings in the file at `path`, a text or a point cloud.

    Columns of a text are separated by semicolons, tabs, commas or blanks. Unless they are separated by commas, a comma
    is a decimal point. The first line may name them: longitude and latitude, or east and north (x and y) in m, and
    depth, elevation or z. By default they are longitude, latitude, depth. Lines that begin with one of COMMENTS are
    skipped. Without a coordinate system the origin of east and north is unknown. Raises ConfigError, MissingExtraError.
    """
    read = _read_cloud if path.lower().endswith(las.ENDINGS) else _read_text
    rows, geographic, system, name, stated, reading_note = read(path, declared)
    length, unit_note = depth_unit(path, stated, declared.unit, system)
    rows[:, 2] *= length
    if system is not None:
        rows[:, :2], geographic = _degrees(rows, system), True
    _check_degrees(rows, geographic, path)
    if geographic and np.ptp(rows[:, 0]) > 180.0:  # on both sides of the 180th meridian
        rows[:, 0] %= 360.0
    require_possible(path, rows[:, 2])
    low, high, axis = float(rows[:, 2].min()), float(rows[:, 2].max()), vertical_axis(system)[1]
    names = first_hint([name], [os.path.basename(path)])
    up, note = detect_direction(path, declared.positive, names, low, high, axis)
    note = join_notes(reading_note, unit_note, note, _several_depths(rows, path))
    return Points(os.path.basename(path), rows[:, 1::-1], -rows[:, 2] if up else rows[:, 2], geographic, note)


def _read_cloud(path: str, declared: Declared) -> _Table:
    rows, crs, unit, note = las.read_las(path)
    crs = crs or (parse_crs(declared.crs) if declared.crs else None)
    return rows, False, crs, "" if vertical_axis(crs)[1] else "height", unit, note


def _read_text(path: str, declared: Declared) -> _Table:
    lines = _lines(path)
    head = next(lines, None)
    if head is None:
        raise ConfigError(f"{path}: has no soundings: a line must have longitude, latitude and depth")
    separator = _separator(head)
    names = _cells(head, separator)
    has_names = not all(map(_is_number, names[:3]))
    first, second, third, geographic = _columns(names, path, declared.layer) if has_names else (0, 1, 2, True)
    rows = _numbers(lines if has_names else chain([head], lines), separator, (first, second, third), path, has_names)
    rows = rows[np.isfinite(rows).all(axis=1)]
    if not len(rows):
        raise ConfigError(f"{path}: has no soundings: a line must have longitude, latitude and depth")
    note, crs = "", parse_crs(declared.crs) if declared.crs else None
    if has_names:
        if not (geographic or crs) and names[first].strip().lower()[0] == "x" and _look_like_degrees(rows):
            raise ConfigError(
                f"{path}: {names[first]} and {names[second]} look like degrees: use --crs EPSG:4326; if they are "
                "metres, name the columns east and north"
            )
    elif crs:
        note = f"{path}: names no columns: read as east, north and depth"
    else:
        order = "longitude, latitude and depth (else name them in a first line)"
        if np.abs(rows[:, 0]).max() <= 90.0 < np.abs(rows[:, 1]).max() <= 360.0:
            rows, order = rows[:, [1, 0, 2]], "latitude, longitude and depth, as the second is beyond 90"
        east, north = rows[0, :2]
        note = f"{path}: names no columns: read as {order}, from {north:g} N {east:g} E"
    name = names[third] if has_names else ""
    others = [text for text in names if is_depth_name(text) and text != name and not declared.layer]
    note = join_notes(note, f"{path}: {name} is used (--layer for {', '.join(others)})" if others else "")
    return rows, geographic, crs, name, unit_in_name(name), note


def _look_like_degrees(rows: Array) -> bool:
    """Return whether positions could be degrees, and would as metres be a spot or steeper than any bed."""
    size = np.ptp(rows[:, :2], axis=0).max()
    is_small = np.abs(rows[:, 0]).max() <= 360.0 and np.abs(rows[:, 1]).max() <= 90.0
    return bool(is_small and size < max(SPOT, np.ptp(rows[:, 2])))


def _several_depths(rows: Array, path: str) -> str:
    """Return a note on places that have several depths, as measurements in the water have; "" for few."""
    places = rows[:, 0] + 1j * rows[:, 1]  # these sort by both columns, ten times as fast as np.unique of rows
    order = np.argsort(places)
    first = np.flatnonzero(np.diff(places[order], prepend=np.nan))
    depths = rows[order, 2]
    share = float((np.diff(first, append=len(rows)) > 1).mean())
    spread = float((np.maximum.reduceat(depths, first) - np.minimum.reduceat(depths, first)).max())
    if share < MAX_REPEATED or spread < 1.0:
        return ""
    return f"{path}: {share:.0%} of its places have several depths, up to {spread:.3g} m apart: are these soundings?"


def _degrees(rows: Array, crs: Any) -> Array:
    """Return longitude and latitude (degrees), (n, 2), of rows that begin with east and north in `crs`."""
    from rasterio.warp import transform

    return np.column_stack(transform(crs, WGS84, rows[:, 0], rows[:, 1]))


def _lines(path: str) -> Iterator[str]:
    """Yield the lines that are neither empty nor comments, without surrounding blanks. Raises ConfigError."""
    check_file(path, LARGEST)
    count = size = 0
    opened = COMPRESSED.get(os.path.splitext(path)[1].lower(), open)
    try:
        with opened(path, "rt", encoding="utf-8-sig", errors="replace") as file:
            while line := file.readline(LONGEST_LINE + 1):
                count, size = count + 1, size + len(line)
                if len(line) > LONGEST_LINE:
                    raise ConfigError(f"{path}: a line of more than {LONGEST_LINE} characters: this is no XYZ or CSV")
                if size > LARGEST or count > MAX_LINES:
                    raise ConfigError(
                        f"{path}: more than {LARGEST >> 20} MiB of text or {MAX_LINES} lines: thin it out, or convert "
                        "it to a GeoTIFF"
                    )
                if "\0" in line:
                    raise ConfigError(f"{path}: is not text in UTF-8: save it as such")
                if (line := line.strip()) and not line.startswith(COMMENTS):
                    yield line
    except (OSError, EOFError, zlib.error, lzma.LZMAError) as error:
        raise ConfigError(f"{path}: cannot be read: {error}") from None


def _separator(line: str) -> str | None:
    """Return the separator of the columns of a file with this first line, None for blanks.

    Commas between numbers that blanks separate are decimal commas.
    """
    mark = next((mark for mark in ";\t," if mark in line), None)
    with_blanks = line.split()
    numbers = [cell.replace(",", ".") for cell in with_blanks if cell[-1] != ","]
    are_decimal = len(numbers) == len(with_blanks) > 2 and all(map(_is_number, numbers))
    return None if mark == "," and are_decimal else mark


def _cells(line: str, separator: str | None) -> list[str]:
    if separator != ",":
        line = line.replace(",", ".")  # a decimal comma
    if separator is None or '"' not in line:
        return line.split(separator)
    return next(csv.reader([line], delimiter=separator))


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _columns(names: Sequence[str], path: str, layer: str | None) -> tuple[int, int, int, bool]:
    """Return the columns of longitude (east), latitude (north) and depth, and whether the first two are degrees.

    `layer`: the name of the column with the depths, if the user chose one.
    """
    short = [name.strip().lower().partition("(")[0].partition("_")[0].strip() for name in names]

    def find(accepted: set[str]) -> int | None:
        return next((index for index, name in enumerate(short) if name in accepted), None)

    plain = [name.strip().lower() for name in names]
    if layer and layer.lower() not in plain:
        raise ConfigError(f"--layer {layer}: {path} has the columns {', '.join(names)}")
    depth = plain.index(layer.lower()) if layer else find(_DEPTH)
    if depth is None:  # for example water_depth
        depth = next((index for index, name in enumerate(names) if is_depth_name(name)), None)
    for across, along, geographic in ((_LONGITUDE, _LATITUDE, True), (_EAST, _NORTH, False)):
        first, second = find(across), find(along)
        if None not in (first, second, depth):
            return first, second, depth, geographic  # type: ignore[return-value] # none of them is None
    raise ConfigError(
        f"{path}: its first line names the columns {', '.join(names)}: longitude, latitude (or east, north) and "
        "depth are required"
    )


def _numbers(lines: Iterable[str], separator: str | None, columns: tuple[int, ...], path: str, offset: int) -> Array:
    rows = array("d")
    for number, line in enumerate(lines, 1 + offset):
        cells = _cells(line, separator)
        try:
            rows.extend([float(cells[column] or "nan") for column in columns])
        except (ValueError, IndexError):
            raise ConfigError(f"{path}: no sounding in row {number}: {clean(line, 60)!r}") from None
    return np.frombuffer(rows, float).reshape(-1, 3)


def _check_degrees(rows: Array, geographic: bool, path: str) -> None:
    if geographic and (np.abs(rows[:, 1]).max() > 90.0 or np.abs(rows[:, 0]).max() > 360.0):
        raise ConfigError(
            f"{path}: the columns of longitude and latitude are not degrees in this order: add a first line "
            '"latitude,longitude,depth" to the file; if they are metres "east,north,depth", and name their coordinate '
            "system, for example --crs EPSG:32605"
        )
    if not geographic and np.abs(rows[:, :2]).max() > MAX_DISTANCE:
        raise ConfigError(f"{path}: has metres of an unknown coordinate system: name it, for example --crs EPSG:32605")
