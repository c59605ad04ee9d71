"""Grid a whole seabed once, store it in the user's cache folder, and cut the part for a dive from it.

Every part then has the same bed as the whole, and a second dive over a chart starts at once. The cache holds the world
file, its depths and the report, in a folder named by a hash of the input files, their times and sizes. The depths are
memory-mapped.
"""

import hashlib
import json
import os
import shutil
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from hil.charts import charted_objects
from hil.charts.build import Report
from hil.charts.build_process import read_and_build
from hil.charts.grid import Extent, grid_of, write_file
from hil.charts.gridding import Progress
from hil.charts.hazards import SeabedModel
from hil.charts.sources.combine import ReadOptions
from hil.charts.sources.sign import Declared
from hil.charts.world_file import write_world
from hil.common.errors import ConfigError
from hil.common.scratch import ScratchFolder
from hil.common.tables import cache_path
from sim.environment.obstacles import Box, Cylinder
from sim.environment.world import load_world

MAX_CACHED_BYTES = 1 << 30  # above this the least recently used seabeds are removed
METHOD = 15  # version of the gridding; increase it when the same files give another result


class WholeSeabed(NamedTuple):
    """The seabed of a whole file. `origin`: latitude and longitude (degrees) of (0, 0), None if not known."""

    model: SeabedModel
    source: str
    origin: tuple[float, float] | None
    report: Report


def load_or_build_seabed(
    path: str, resolution: float | None = None, progress: Progress = lambda share: None,
    declared: Declared = Declared(), near: tuple[float, float] | None = None,
) -> WholeSeabed:  # fmt: skip
    """Return the seabed in the file at `path`, from the cache if it was gridded before.

    `resolution`: m, by default that of the data; `declared`: what the user says of its values. Of a file
    that is too large for a world it is the part around `near` (latitude, longitude in degrees). Raises ConfigError,
    MissingExtraError.
    """
    root, how = os.path.join(os.path.dirname(cache_path(path)), "charts"), (path, resolution, *declared)
    of_whole, of_part = (os.path.join(root, _key(*how, *part)) for part in ((), near or ("centre",)))
    cached = _load(of_whole) or _load(of_part)
    if cached is not None:
        return cached
    options = ReadOptions(declared, crop=True, near=near)
    survey, built = read_and_build([path], None, resolution, options, progress)
    seabed = WholeSeabed(built.model, survey.source, survey.origin, built.report)
    with suppress(OSError, ConfigError):  # the disk is full or the folder not writable: it is not cached
        folder = of_part if survey.is_cropped else of_whole
        _store(seabed, folder)
        return _load(folder) or seabed
    return seabed


def cut_seabed(model: SeabedModel, extent: Extent) -> SeabedModel:
    """Return the part of `model` that covers `extent` (m), with unchanged nodes, and the obstacles inside it."""
    grid, slices = model.grid, []
    for axis, (low, high) in ((grid.north, extent[:2]), (grid.east, extent[2:])):
        first = max(0, min(int(np.searchsorted(axis, low, "right")) - 1, len(axis) - 2))
        last = max(first + 1, min(int(np.searchsorted(axis, high)), len(axis) - 1))
        slices.append(slice(first, last + 1))
    cut = grid._replace(
        depths=np.array(grid.depths[slices[0], slices[1]]),
        north_min=float(grid.north[slices[0].start]),
        east_min=float(grid.east[slices[1].start]),
    )
    south, north, west, east = cut.extent

    def within(thing: Cylinder | Box) -> bool:
        return south <= thing.north <= north and west <= thing.east <= east

    return SeabedModel(
        cut, tuple(filter(within, model.cylinders)), tuple(filter(within, model.boxes)),
        charted_objects.clip_charted(model.charted, cut.extent),
        charted_objects.cut_bottom_grid(model.bottom, cut.extent),
    )  # fmt: skip


def _key(path: str, *how: float | str | None) -> str:
    """Return the cache key of a file, of files with the same stem beside it (updates), and of the options `how`."""
    folder, stem = os.path.split(os.path.splitext(os.path.abspath(path))[0])
    stamps: list[tuple[str, int, int]] = []
    with suppress(OSError), os.scandir(folder) as entries:  # the reader reports what is missing
        files = [entry for entry in entries if entry.is_file() and os.path.splitext(entry.name)[0] == stem]
        stamps = sorted((file.name, file.stat().st_mtime_ns, file.stat().st_size) for file in files)
    text = json.dumps([METHOD, os.path.abspath(path), how, stamps])
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def _load(folder: str) -> WholeSeabed | None:
    """Return the seabed cached in `folder`; None if there is none that can be used."""
    try:
        # Do not use files that another user may have put there. On Windows the folder is in the user's profile.
        if hasattr(os, "getuid") and os.stat(folder).st_uid != os.getuid():
            return None
        with open(os.path.join(folder, "report.json"), encoding="utf-8") as file:
            report = Report(**json.load(file))
        world = load_world(os.path.join(folder, "chart.toml"))
        bottom = None
        if world.bottom_map is not None:
            keys = world.bottom_map.keys
            codes = world.bottom_map.grid()
            bottom = charted_objects.BottomGrid(codes, keys.north_min, keys.east_min, keys.resolution)
        others = charted_objects.ChartedObjects(world.pipeline, world.all_zones())
        model = SeabedModel(grid_of(world), world.cylinder, world.box, others, bottom)
        os.utime(folder)
    except (OSError, ValueError, TypeError, ConfigError):  # not cached, or damaged
        return None
    return WholeSeabed(model, world.source, world.origin, report)


def _store(seabed: WholeSeabed, folder: str) -> None:
    """Write `seabed` to a temporary folder, then rename that to `folder`. Raises OSError, ConfigError."""
    charts = os.path.dirname(folder)
    os.makedirs(charts, mode=0o700, exist_ok=True)
    with ScratchFolder("chart", charts) as scratch:
        write_world(scratch.file("chart.toml"), seabed.model, seabed.source, seabed.origin, ("Written by uuv-hil.",))
        write_file(scratch.file("report.json"), json.dumps(seabed.report._asdict()).encode())
        with suppress(OSError):
            shutil.rmtree(folder)  # it may exist and be damaged
        os.rename(scratch.path, folder)
    _prune(charts, folder)


def _prune(charts: str, fresh: str) -> None:
    """Remove the least recently used seabeds until the others fit, but never `fresh`. Raises OSError."""
    with os.scandir(charts) as entries:
        folders = sorted((e for e in entries if e.is_dir()), key=lambda entry: -entry.stat().st_mtime_ns)
    size = 0
    for entry in folders:
        with os.scandir(entry.path) as files:
            size += sum(file.stat().st_size for file in files)
        if size > MAX_CACHED_BYTES and entry.path != fresh:
            shutil.rmtree(entry.path, ignore_errors=True)
