"""Grid a whole seabed once, store it in the user's cache folder, and cut from it the part that is flown over.

So every part has the bed that the whole has, and the second dive over a chart waits for nothing. The cache holds a
world's file, its depths and the report, in a folder named by a hash of the input files, their times and sizes. The
depths are mapped, not read.
"""

import hashlib
import json
import os
import shutil
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from hil.charts import charted
from hil.charts.build import Report, build
from hil.charts.grid import Extent, grid_of, write_file
from hil.charts.gridding import Progress
from hil.charts.hazards import Placed
from hil.charts.sources.choose import read_sources
from hil.charts.sources.sign import Positive
from hil.charts.world_file import write_world
from hil.common.errors import ConfigError
from hil.common.scratch import ScratchFolder
from hil.common.tables import cache_path
from sim.environment.obstacles import Box, Cylinder
from sim.environment.world import World, load_world

MOST_CACHED_BYTES = 1 << 30  # beyond it those are removed that were not used for longest
METHOD = 8  # to be counted up when the same files are gridded in another way


class Whole(NamedTuple):
    """All of a seabed: grid and obstacles, where on the earth (0, 0) is, what it was made of and how good it is."""

    placed: Placed
    source: str
    origin: tuple[float, float] | None
    report: Report
    is_cached: bool


def whole_bed(
    path: str, resolution: float | None = None, progress: Progress = lambda share: None, positive: Positive = "auto",
    crs: str | None = None,
) -> Whole:  # fmt: skip
    """Return the seabed in the file at `path`, gridded at `resolution` (m), at what its data resolve if None.

    `positive` and `crs` as in the readers. From the cache if it was gridded before. Raises ConfigError,
    MissingExtraError.
    """
    folder = os.path.join(os.path.dirname(cache_path(path)), "charts", _key(path, resolution, positive, crs))
    cached = _load(folder)
    if cached is not None:
        return cached
    survey, extent = read_sources([path], None, resolution, positive=positive, crs=crs)
    built = build(survey, extent, resolution, progress)
    whole = Whole(built.placed, survey.source, survey.origin, built.report, False)
    with suppress(OSError, ConfigError):  # a full disk, or a folder we may not write: it is made again next time
        _store(whole, folder)
        return (_load(folder) or whole)._replace(is_cached=False)
    return whole


def cut(placed: Placed, extent: Extent) -> Placed:
    """Return the nodes of `placed` around `extent` (m), the same ones, and what stands between them."""
    grid, parts = placed.grid, []
    for axis, (low, high) in ((grid.north, extent[:2]), (grid.east, extent[2:])):
        first = max(0, min(int(np.searchsorted(axis, low, "right")) - 1, len(axis) - 2))
        last = max(first + 1, min(int(np.searchsorted(axis, high)), len(axis) - 1))
        parts.append(slice(first, last + 1))
    part = grid._replace(
        depths=np.array(grid.depths[parts[0], parts[1]]),
        north_min=float(grid.north[parts[0].start]),
        east_min=float(grid.east[parts[1].start]),
    )
    south, north, west, east = part.extent

    def within(thing: Cylinder | Box) -> bool:
        return south <= thing.north <= north and west <= thing.east <= east

    return Placed(
        part, tuple(filter(within, placed.cylinders)), tuple(filter(within, placed.boxes)),
        charted.within(placed.charted, part.extent), charted.cut_bottom(placed.bottom, part.extent),
    )  # fmt: skip


def _key(path: str, *how: float | str | None) -> str:
    """Return a name for the file with what may lie beside it, as updates do, read in this way."""
    folder, stem = os.path.split(os.path.splitext(os.path.abspath(path))[0])
    stamps: list[tuple[str, int, int]] = []
    with suppress(OSError), os.scandir(folder) as entries:  # the reader reports what is missing
        files = [entry for entry in entries if entry.is_file() and os.path.splitext(entry.name)[0] == stem]
        stamps = sorted((file.name, file.stat().st_mtime_ns, file.stat().st_size) for file in files)
    text = json.dumps([METHOD, os.path.abspath(path), how, stamps])
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def _load(folder: str) -> Whole | None:
    """Return what is cached in `folder`; None if there is nothing that can be used."""
    try:
        # Never trust what another user left there. On Windows it lies among the user's own files.
        if hasattr(os, "getuid") and os.stat(folder).st_uid != os.getuid():
            return None
        with open(os.path.join(folder, "report.json"), encoding="utf-8") as file:
            report = Report(**json.load(file))
        world = load_world(os.path.join(folder, "chart.toml"))
        placed = _placed(world)
        os.utime(folder)
    except (OSError, ValueError, TypeError, ConfigError):  # none, or damaged
        return None
    return Whole(placed, world.source, world.origin, report, True)


def _placed(world: World) -> Placed:
    """Return the parts of a cached world. Raises ConfigError."""
    bottom = None
    if world.bottom_map is not None:
        keys = world.bottom_map.keys
        bottom = charted.BottomGrid(world.bottom_map.grid(), keys.north_min, keys.east_min, keys.resolution)
    others = charted.Charted(world.pipeline, world.all_zones())
    return Placed(grid_of(world), world.cylinder, world.box, others, bottom)


def _store(whole: Whole, folder: str) -> None:
    """Write `whole` into a new folder, which is renamed to `folder` when all is in it. Raises OSError, ConfigError."""
    charts = os.path.dirname(folder)
    os.makedirs(charts, mode=0o700, exist_ok=True)
    with ScratchFolder("chart", charts) as scratch:
        write_world(scratch.file("chart.toml"), whole.placed, whole.source, whole.origin, ("Written by uuv-hil.",))
        write_file(scratch.file("report.json"), json.dumps(whole.report._asdict()).encode())
        with suppress(OSError):
            shutil.rmtree(folder)  # a damaged one
        os.rename(scratch.path, folder)
    _prune(charts, folder)


def _prune(charts: str, fresh: str) -> None:
    """Remove the cached seabeds that were not used for longest, never `fresh`, until the rest fits. Raises OSError."""
    with os.scandir(charts) as entries:
        folders = sorted((e for e in entries if e.is_dir()), key=lambda entry: -entry.stat().st_mtime_ns)
    size = 0
    for entry in folders:
        with os.scandir(entry.path) as files:
            size += sum(file.stat().st_size for file in files)
        if size > MOST_CACHED_BYTES and entry.path != fresh:
            shutil.rmtree(entry.path, ignore_errors=True)
