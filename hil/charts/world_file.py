"""Write a world to disk: NAME.toml, and NAME.f32 with the depths of its seabed."""

import os
from collections.abc import Iterator, Sequence
from datetime import date
from typing import Any

import numpy as np

from hil.charts.grid import write_file
from hil.charts.hazards import SeabedModel
from hil.common.text import toml_text
from sim.environment.geomagnetism import field_at
from sim.environment.things.bottom_map import BottomMapKeys

_USUAL = "where nothing else is known; its relief below the grid: APL-UW 1994, TR 9407"


def write_world(
    path: str, model: SeabedModel, source: str, origin: tuple[float, float] | None, notes: Sequence[str]
) -> None:
    """Write `model` to `path` (`.toml`) with `notes` as comments; depths, natures and zones go to files beside it.

    The depths are little-endian float32, row by row from the south-west corner, nan if unknown. With an `origin` the
    file has the earth's magnetic field at that place today. Raises ConfigError, MissingExtraError.
    """
    stem = os.path.splitext(os.path.basename(path))[0]
    grid = model.grid
    write_file(os.path.splitext(path)[0] + ".f32", np.ascontiguousarray(grid.depths, "<f4").tobytes())
    terrain = {
        "file": f"{stem}.f32", "north_min": grid.north_min, "east_min": grid.east_min,
        "resolution": grid.resolution, "rows": grid.depths.shape[0], "columns": grid.depths.shape[1],
    }  # fmt: skip
    world = {"name": stem, "source": source, "extent": grid.extent, "depth": max(0.1, grid.deepest)}
    lines = [*(f"# {note}" for note in notes), *keys_of(world)]
    if origin is not None:
        lines.append(f"origin = {_toml(origin)} # latitude, longitude")
        lines.append(_magnetic_field(origin))
    zones = [line for zone in model.charted.zones for line in _table("zone", zone)]
    if zones:
        lines.append(f'zones = "{stem}.zones.toml"')
        write_file(os.path.splitext(path)[0] + ".zones.toml", ("\n".join(zones) + "\n").encode())
    lines += ["", "[terrain]", *keys_of(terrain)]
    # A grid has no relief between its nodes: sonars and cameras would see smooth facets.
    lines += ["", f"[bottom] # {_USUAL}", *keys_of({"kind": "sand"})]
    if model.bottom is not None:
        codes, north_min, east_min, resolution = model.bottom
        rows, columns = codes.shape
        write_file(os.path.splitext(path)[0] + ".bottom", np.ascontiguousarray(codes).tobytes())
        keys = BottomMapKeys(f"{stem}.bottom", north_min, east_min, resolution, rows, columns)
        lines += ["", "[bottom_map]", *keys_of(keys._asdict())]
    for pipeline in model.charted.pipelines:
        lines += _table("pipeline", pipeline)
    for name, obstacles in (("cylinder", model.cylinders), ("box", model.boxes)):
        for obstacle in obstacles:
            lines += _table(name, obstacle)
    write_file(path, ("\n".join(lines) + "\n").encode())


def _magnetic_field(origin: tuple[float, float]) -> str:
    """Return the key with the earth's field at `origin` today. Boards read it here, as they have no field model."""
    today = date.today()
    start, end = date(today.year, 1, 1), date(today.year + 1, 1, 1)
    field = field_at(*origin, year=today.year + (today - start) / (end - start))
    return f"magnetic_field = {_toml(field.angles)} # T, rad, rad: {field.model}, {field.year:.1f}"


def _table(name: str, record: Any) -> list[str]:
    """Return the lines of a record as a table of an array, without defaults, which makes the file faster to load."""
    usual = record._field_defaults
    return ["", f"[[{name}]]", *keys_of({k: v for k, v in record._asdict().items() if v != usual.get(k)})]


def keys_of(table: dict[str, Any]) -> Iterator[str]:
    """Return an iterator over the lines of TOML, one for each key."""
    return (f"{key} = {_toml(value)}" for key, value in table.items())


def _toml(value: Any) -> str:
    return toml_text(value, lambda number: repr(round(number, 9) + 0.0))
