"""A way out of a file: TOML, or CSV as a spreadsheet writes it.

    smooth = true                  north, east, depth
    [[waypoint]]                   0.0, 0.0, 3.0
    north = 0.0                    10.0, 2.0, 4.0
    east = 0.0
    depth = "3 m"

In a CSV the first line names the columns, in any order; empty lines and those that begin with # do not count.
"""

import csv
from collections.abc import Iterator
from typing import Annotated, Any, NamedTuple

from hil.autonomy.curves import Curve, Position, polyline
from hil.autonomy.spline import Spline
from hil.errors import ConfigError, MissionError
from hil.schema import Range, load, parse


class Waypoint(NamedTuple):
    """A point of a way: m north and east, and m deep."""

    north: Annotated[float, Range(-1e5, 1e5, "m")]
    east: Annotated[float, Range(-1e5, 1e5, "m")]
    depth: Annotated[float, Range(-1.0, 11_000.0, "m")]


class WaypointFile(NamedTuple):
    """A way as a file tells it: [[waypoint]] tables, and whether the corners between are rounded by a spline."""

    waypoint: tuple[Waypoint, ...]
    smooth: bool = False


def read_waypoints(path: str) -> Curve:
    """The way in the TOML or, if it ends in `.csv`, CSV file at `path`; that of a CSV is of straight lines.

    Raises ConfigError naming file and key or line, MissionError naming the file if the points make no way.
    """
    way = _read_csv(path) if path.lower().endswith(".csv") else load(path, WaypointFile)
    points: list[Position] = [(point.north, point.east, point.depth) for point in way.waypoint]
    try:
        return Spline(points) if way.smooth else polyline(points)
    except MissionError as error:
        raise MissionError(f"{path}: {error}") from None


def _read_csv(path: str) -> WaypointFile:
    try:
        with open(path, encoding="utf-8-sig", newline="") as file:
            return WaypointFile(tuple(_waypoints(file.read(), path)))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise ConfigError(f"{path}: not a CSV file: {error}") from None


def _waypoints(text: str, path: str) -> Iterator[Waypoint]:
    names: list[str] = []
    for number, row in enumerate(csv.reader(text.splitlines(), skipinitialspace=True), 1):
        cells = [cell.strip() for cell in row]
        if not any(cells) or cells[0].startswith("#"):
            continue
        if not names:
            names = cells
            if sorted(names) != sorted(Waypoint._fields):
                raise ConfigError(
                    f"{path}: line {number}: name the columns north, east, depth; found {', '.join(names)}"
                )
        elif len(cells) != len(names):
            raise ConfigError(f"{path}: line {number}: {len(names)} numbers expected, found {len(cells)}")
        else:
            table: dict[str, Any] = {name: _number(cell) for name, cell in zip(names, cells, strict=True)}
            yield parse(table, Waypoint, f"{path}: line {number}")


def _number(cell: str) -> float | str:
    """The number in a cell; what is none goes to the schema as text, which knows units and what to say."""
    try:
        return float(cell)
    except ValueError:
        return cell
