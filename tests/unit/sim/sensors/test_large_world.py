"""A camera over a world of 50 km x 50 km reads the surroundings only."""

import os
import tracemalloc
from array import array
from pathlib import Path

import numpy as np
import psutil

from sim.environment.relief import Fractal
from sim.environment.terrain import Terrain, covering
from sim.environment.world import World, load_world
from sim.rays.scene import RayScene
from sim.sensors.imaging.scenery import Scenery

SIDE = 10_001


def test_shading_by_curvature_equals_that_of_the_whole_grid() -> None:
    """Each hit gets what a grid of all nodes would give it, also at the grid's rim."""
    grid = covering((0.0, 60.0, 0.0, 40.0), 1.0)
    terrain = Terrain(grid, Fractal(depth=9.0, deviation=1.0).depths(grid), 9.0)
    world = World("w", "", (0.0, 60.0, 0.0, 40.0), 9.0, terrain=terrain)
    assert world.terrain is not None
    nodes = np.asarray(world.terrain.depths, float).reshape(grid.rows, grid.columns)
    padded = np.pad(nodes, 1, mode="edge")
    mean = 0.25 * (padded[:-2, 1:-1] + padded[2:, 1:-1] + padded[1:-1, :-2] + padded[1:-1, 2:])
    brightness = np.clip(1.0 + 3.0 * (mean - nodes), 0.7, 1.3)
    points = np.random.default_rng(1).uniform((-3.0, -3.0, 0.0), (63.0, 43.0, 9.0), (400, 3))
    rows, columns = (
        np.clip(np.floor(points[:, k] + 0.5).astype(int), 0, count - 1)
        for k, count in enumerate((grid.rows, grid.columns))
    )
    scenery = Scenery(world, 2)
    for part in (slice(None), slice(0, 1), rows > grid.rows - 6):
        found = scenery._curvature_brightness(points[part].T.astype(np.float32))
        np.testing.assert_allclose(found, brightness[rows[part], columns[part]], atol=2e-4)


def resident_mb() -> float:
    return float(psutil.Process().memory_info().rss) / 1e6


def large_world(tmp_path: Path) -> World:
    """Return a world of 100 million nodes, all 0 m deep, that uses no space on the disk."""
    (tmp_path / "large.toml").write_text(
        'name = "large"\nsource = ""\nextent = [-25000.0, 25000.0, -25000.0, 25000.0]\ndepth = 30.0\n'
        '[terrain]\nfile = "large.f32"\nnorth_min = -25000.0\neast_min = -25000.0\nresolution = 5.0\n'
        f"rows = {SIDE}\ncolumns = {SIDE}\n"
    )
    with open(tmp_path / "large.f32", "wb") as file:
        os.truncate(file.fileno(), 4 * SIDE * SIDE)
    return load_world(str(tmp_path / "large.toml"))


def test_rays_use_memory_only_for_the_area_they_cross(tmp_path: Path) -> None:
    """A table with one number for each block of 4 x 4 cells would take 25 MB."""
    world = large_world(tmp_path)
    directions = array("d", [0.6, 0.0, 0.8, 0.0, -1.0, 0.0, 0.0, 0.999, 0.0447])
    RayScene(World("flat", "", world.extent, 30.0)).ranges((0.0, 0.0, -1.0), directions, 50.0)
    scenes, growths = [], []
    for _ in range(3):  # other code of this process may allocate memory meanwhile
        before = resident_mb()
        scenes.append(RayScene(world))
        distances = scenes[-1].ranges((2.0, 3.0, -1.0), directions, 50.0)
        growths.append(resident_mb() - before)
    assert min(growths) < 5.0
    np.testing.assert_allclose(distances, [1.25, np.inf, 1.0 / 0.0447], rtol=1e-12)


def test_a_world_of_100_million_nodes_is_not_loaded_completely(tmp_path: Path) -> None:
    world = large_world(tmp_path)
    tracemalloc.start()
    scenery = Scenery(world, 2)
    points = np.random.default_rng(1).uniform(-30.0, 30.0, (3, 10_000)).astype(np.float32)
    bend = scenery._curvature_brightness(points)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert (bend == 1.0).all()
    assert peak < 32 << 20, "400 MB of depths are mapped, and no other array is as large"
