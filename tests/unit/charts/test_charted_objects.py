"""Cables, pipelines, areas and seabed natures of a chart: what a world gets of them, and its files both ways."""

from pathlib import Path

import numpy as np
import pytest

from hil.charts.charted_objects import (
    ChartedObjects,
    Nature,
    clip_charted,
    cut_bottom_grid,
    nature_of,
    pipelines_of,
    rasterise_natures,
    zones_of,
)
from hil.charts.grid import Grid
from hil.charts.hazards import SeabedModel
from hil.charts.sources.s57 import Feature
from hil.charts.world_file import write_world
from hil.common.errors import ConfigError
from sim.environment.things.zones import Zone
from sim.environment.world import load_world

NOWHERE = np.empty((0, 3))
LINE = np.array([(0.0, 0.0), (30.0, 40.0), (60.0, 40.0)])
SQUARE = (np.array([(0.0, 0.0), (0.0, 100.0), (100.0, 100.0), (100.0, 0.0), (0.0, 0.0)]),)
HOLE = (*SQUARE, np.array([(40.0, 40.0), (40.0, 60.0), (60.0, 60.0), (60.0, 40.0), (40.0, 40.0)]))
GRID = Grid(np.full((41, 41), 12.0, np.float32), 0.0, 0.0, 5.0)


def feature(kind: str, is_area: bool = False, codes: dict[str, list[int]] | None = None, **numbers: float) -> Feature:
    return Feature(kind, numbers, NOWHERE, (), is_area, codes or {}, "its name")


def test_pipelines_lie_on_the_bed_or_are_buried_below_it() -> None:
    (pipe,) = pipelines_of(feature("PIPSOL"), [LINE])
    assert (pipe.kind, pipe.diameter, pipe.height, pipe.name) == ("pipeline", 0.6, 0.0, "its name")
    assert pipe.points == ((0.0, 0.0), (30.0, 40.0), (60.0, 40.0))
    (cable,) = pipelines_of(feature("CBLSUB", BURDEP=1.5), [LINE])
    assert (cable.kind, cable.diameter) == ("cable", 0.1)
    assert cable.is_buried
    assert cable.height + cable.diameter == pytest.approx(-1.5)
    assert pipelines_of(feature("DEPCNT"), [LINE]) == []


def test_an_area_becomes_a_zone_with_its_rules_and_without_holes() -> None:
    (zone,) = zones_of(feature("RESARE", True, {"RESTRN": [1, 7, 999]}), HOLE, 1.0)
    assert (zone.kind, zone.name, zone.rule) == ("restricted", "its name", "anchoring prohibited, entry prohibited")
    assert sorted(zone.outline) == [(0.0, 0.0), (0.0, 100.0), (100.0, 0.0), (100.0, 100.0)]
    kinds = [zones_of(feature(kind, True), SQUARE, 1.0)[0].kind for kind in ("ACHARE", "DMPGRD", "MIPARE", "CBLARE")]
    assert kinds == ["anchorage", "dumping", "military", "cable"]
    assert zones_of(feature("MARCUL", True), SQUARE, 1.0)[0].kind == "farm"
    assert zones_of(feature("DEPARE", True), SQUARE, 1.0) == []
    cut = clip_charted(ChartedObjects((), (zone,)), (-50.0, 50.0, -50.0, 50.0)).zones
    assert sorted(cut[0].outline) == [(0.0, 0.0), (0.0, 50.0), (50.0, 0.0), (50.0, 50.0)]
    assert clip_charted(ChartedObjects((), (zone,)), (200.0, 300.0, 0.0, 50.0)).zones == ()


def test_natures_apply_to_the_nearest_point_and_areas_take_precedence() -> None:
    mud = nature_of(feature("SBDARE", codes={"NATSUR": [1, 4]}), np.array([(20.0, 20.0)]), ())
    sand = nature_of(feature("SBDARE", codes={"NATSUR": [4]}), np.array([(180.0, 20.0)]), ())
    rock = nature_of(feature("SBDARE", True, {"NATSUR": [9]}), np.empty((0, 2)), SQUARE)
    assert mud is not None
    assert sand is not None
    assert rock is not None
    assert nature_of(feature("SBDARE", codes={"NATSUR": []}), np.array([(0.0, 0.0)]), ()) is None
    painted = rasterise_natures((mud, sand), GRID, 1.0)
    assert painted is not None
    assert painted.resolution == 10.0
    assert painted.codes.shape == (21, 21)
    assert (painted.codes[2, 2], painted.codes[18, 2], painted.codes[2, 20]) == (1, 4, 0), "100 m on paper are too far"
    both = rasterise_natures((mud, sand, rock), GRID, 1.0)
    assert both is not None
    assert (both.codes[2, 2], both.codes[18, 2]) == (9, 4)
    part = cut_bottom_grid(painted, (150.0, 200.0, 0.0, 50.0))
    assert part is not None
    assert (part.north_min, part.codes[-2, 1]) == (150.0, 4)
    assert rasterise_natures((Nature(4, np.array([(9e5, 9e5)])),), GRID, 1.0) is None


def test_a_worlds_files_are_read_back_equal(tmp_path: Path) -> None:
    zones = (Zone("restricted", ((0.0, 0.0), (0.0, 10.0), (10.0, 10.0)), 'the "old" reserve'),)
    pipes = tuple(pipelines_of(feature("PIPSOL"), [LINE]))
    painted = rasterise_natures((Nature(9, np.array([(20.0, 20.0)])),), GRID, 1.0)
    path = str(tmp_path / "bay.toml")
    write_world(path, SeabedModel(GRID, (), (), ChartedObjects(pipes, zones), painted), "test", None, ())
    world = load_world(path)
    assert world.pipeline == pipes
    assert (world.zone, world.all_zones()) == ((), zones)
    assert world.bottom_map is not None
    assert world.bottom_map.codes(np.array([21.0]), np.array([19.0])).tolist() == [9]
    (tmp_path / "bay.zones.toml").unlink()
    assert load_world(path).name == "bay", "zones are read on request only"
    with pytest.raises(ConfigError, match=r"bay\.zones\.toml: the zones of a world cannot be read"):
        load_world(path).all_zones()
