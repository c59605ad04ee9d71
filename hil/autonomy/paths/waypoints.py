"""Read a path of waypoints from a TOML or CSV file.

    smooth = true                  north, east, depth
    [[waypoint]]                   0.0, 0.0, 3.0
    north = 0.0                    10.0, 2.0, 4.0
    east = 0.0
    depth = "3 m"

The first line of a CSV file names the columns, in any order. Empty lines and lines that begin with # are ignored.
"""

import csv
from collections.abc import Iterator
from typing import Annotated, Any, NamedTuple

from hil.autonomy.paths.curves import Curve, Position, polyline
from hil.autonomy.paths.spline import Spline
from hil.common.errors import ConfigError, MissionError
from hil.common.schema import Range, load, parse
from hil.common.tables import read_bytes


class Waypoint(NamedTuple):
    """A waypoint: north, east and depth in m."""

    north: Annotated[float, Range(-1e5, 1e5, "m")]
    east: Annotated[float, Range(-1e5, 1e5, "m")]
    depth: Annotated[float, Range(-1.0, 11_000.0, "m")]


class WaypointFile(NamedTuple):
    """Contents of a path file: [[waypoint]] tables, and whether a spline rounds the corners."""

    waypoint: tuple[Waypoint, ...]
    smooth: bool = False


def read_waypoints(path: str) -> Curve:
    """Return the path in the file at `path`: CSV if the name ends in `.csv`, else TOML. A CSV path has straight legs.

    Raises ConfigError that names the file and the key or line, MissionError if no path can be made of the waypoints.
    """
    file = _read_csv(path) if path.lower().endswith(".csv") else load(path, WaypointFile)
    points: list[Position] = [(point.north, point.east, point.depth) for point in file.waypoint]
    try:
        return Spline(points) if file.smooth else polyline(points)
    except MissionError as error:
        raise MissionError(f"{path}: {error}") from None


def _read_csv(path: str) -> WaypointFile:
    try:
        return WaypointFile(tuple(_waypoints(read_bytes(path).decode("utf-8-sig"), path)))
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
    """Return the number in a cell. Return other text unchanged: the schema handles units and errors."""
    try:
        return float(cell)
    except ValueError:
        return cell
