"""Exports of a large world take less memory than its grid."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import rasterio

from hil.autonomy.paths.occupancy import OccupancyGrid

SIDE, SHOAL, DEEP = 4000, 2500, 12.0  # nodes; the first row that is no water; m
MAX_MB = 50  # the grid alone has 64
# What the process took at most, before and after: ru_maxrss would count the process that has started this one.
RUN = """
import re, sys
import rasterio, scipy.ndimage
import hil.scenario.world_map, hil.charts.geotiff, hil.commands.world as world
most = lambda: int(re.search(r"VmHWM:\\s+(\\d+)", open("/proc/self/status").read())[1])
before = most()
world.main(sys.argv[1:])
print("MB", (most() - before) / 1024.0)
"""


@pytest.fixture(scope="module")
def large(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a world of 1 m cells, DEEP in the south, the rest of it a hole in its file: 0 m."""
    folder = tmp_path_factory.mktemp("large")
    with open(folder / "w.f32", "wb") as file:
        for _ in range(SHOAL):
            file.write(np.full(SIDE, DEEP, "<f4").tobytes())
        file.truncate(4 * SIDE * SIDE)
    (folder / "w.toml").write_text(
        f"name = 'w'\nsource = 'x'\nextent = [0.0, {SIDE - 1}.0, 0.0, {SIDE - 1}.0]\ndepth = {DEEP}\n[terrain]\n"
        f"file = 'w.f32'\nnorth_min = 0.0\neast_min = 0.0\nresolution = 1.0\nrows = {SIDE}\ncolumns = {SIDE}\n"
    )
    return folder


def export(folder: Path, name: str, *options: str) -> float:
    """Return how many MB it took."""
    completed = subprocess.run(
        [sys.executable, "-c", RUN, "export", str(folder / "w.toml"), str(folder / name), *options],
        capture_output=True, text=True, check=True, env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
    )  # fmt: skip
    return float(completed.stdout.split("MB ")[1])


@pytest.mark.skipif(sys.platform != "linux", reason="memory is read in /proc")
@pytest.mark.parametrize("resolution", [1.0, 1.6])
def test_a_raster_takes_less_memory_than_its_grid(large: Path, resolution: float) -> None:
    assert export(large, "w.tif", "--resolution", str(resolution)) < MAX_MB
    with rasterio.open(large / "w.tif") as raster:
        column = raster.read(1)[::-1, 77]
    deep = np.arange(len(column)) * resolution <= SHOAL - 1
    assert (column[deep] == -DEEP).all()
    assert abs(column[np.flatnonzero(deep)[-1] + 2 :]).max() == 0.0


@pytest.mark.skipif(sys.platform != "linux", reason="memory is read in /proc")
def test_a_map_takes_less_memory_than_the_grid(large: Path) -> None:
    assert export(large, "w.pgm", "--depth", "5") < MAX_MB
    cells = OccupancyGrid.read(str(large / "w.yaml")).cells
    assert not cells[: SHOAL - 2].any()
    assert cells[SHOAL:].all()
