"""`uuv-hil world`: build worlds from charts, draw, export and list them."""

import os
from pathlib import Path

import numpy as np
import pytest

from hil.commands import world as command
from hil.common.errors import ConfigError
from sim.environment.geomagnetism import field_at
from sim.environment.obstacles import STANDING
from sim.environment.world import load_world
from tests.support.charts.s57_encoder import square
from tests.support.charts.small_cell import bay, bed

pytestmark = pytest.mark.usefixtures("charts_in_process")


def chart(folder: Path) -> str:
    return bay().write(folder / "BAY.000")


@pytest.mark.usefixtures("own_process")
def test_a_chart_becomes_a_world_that_the_simulator_loads(tmp_path: Path) -> None:
    out = str(tmp_path / "worlds" / "bay")
    assert (
        command.main(["build", chart(tmp_path), "--resolution", "20", "-o", out, "--plot", str(tmp_path / "b.png")])
        == 0
    )
    assert (tmp_path / "b.png").stat().st_size > 20_000
    world = load_world(f"{out}.toml")
    assert world.name == "bay"
    assert "ENC BAY" in world.source
    assert world.origin == pytest.approx((54.005, 10.008))
    assert world.magnetic_field is not None  # for boards, which have no model of it
    first, last = (field_at(*world.origin or (0.0, 0.0), year=year).angles for year in (2025.0, 2030.0))
    for found, ends in zip(world.magnetic_field, zip(first, last, strict=True), strict=True):
        assert min(ends) - 1e-9 <= found <= max(ends) + 1e-9
    assert world.terrain is not None
    piles = sorted((pile.top, pile.bottom) for pile in world.cylinder)
    assert piles == [(-100.0, 1.0), (-100.0, STANDING), (5.5, STANDING)], "one of them floats"
    metres = (54.003 - 54.005) * 111_260.0
    assert world.seabed(metres, 0.0) == pytest.approx(bed(54.003, 10.008), abs=0.3)
    assert world.seabed(440.0, 0.0) < -2.0, "land"
    assert world.depth == pytest.approx(max(world.terrain.depths), abs=1e-4)
    size = world.terrain.grid.rows * world.terrain.grid.columns * 4
    assert os.path.getsize(f"{out}.f32") == size
    depths = np.fromfile(f"{out}.f32", "<f4").reshape(world.terrain.grid.rows, -1)
    assert depths[3, 7] == np.float32(
        world.seabed(world.terrain.grid.north_min + 60.0, world.terrain.grid.east_min + 140.0)
    )


def test_lighthouses_and_houses_become_piles_only_where_they_stand_in_water(tmp_path: Path) -> None:
    cell = bay()
    for latitude in (54.005, 54.009):
        cell.point(74, (latitude, 10.012))
        cell.area(12, square(latitude, 10.002, latitude + 1e-4, 10.0022))
    path = cell.write(tmp_path / "BAY.000")
    assert command.main(["build", path, "--resolution", "20", "-o", str(tmp_path / "w")]) == 0
    dry_piles = {(pile.north, pile.east) for pile in load_world(str(tmp_path / "w.toml")).cylinder if pile.top < 0.0}
    middles = [(0.0, 262.0), (6.0, -386.0)]  # m
    for north, east in middles:
        assert [1 for n, e in dry_piles if abs(n - north) < 3.0 and abs(e - east) < 3.0] == [1], dry_piles
    assert len(dry_piles) == 4, "with the pile and what floats"


def test_a_world_is_drawn_and_exported_in_each_format(tmp_path: Path) -> None:
    assert command.main(["show", "harbour", "-o", str(tmp_path / "h.png"), "--resolution", "4"]) == 0
    assert command.main(["export", "harbour", str(tmp_path / "h.tif")]) == 0
    assert (tmp_path / "h.tif").stat().st_size > 1000
    assert command.main(["export", "harbour", str(tmp_path / "h.pgm"), "--depth", "4", "--resolution", "1"]) == 0
    assert (tmp_path / "h.yaml").exists()


@pytest.mark.parametrize(("arguments", "output"), [
    (["export", "harbour", "h.obj"], r"h.obj: no format .obj: .pgm, .tif"),
    (["export", "harbour", "h.pgm"], "--depth M goes with a map"),
    (["list", "no_such_folder"], "no_such_folder: no such folder"),
    (["build", "x.000", "-o", "w", "--area", "1,2,3"], "expected SOUTH,WEST,NORTH,EAST in degrees"),
    (["build", "x.000", "-o", "w", "--area", "60,2,50,3"], "south to north growing, from west to east"),
    (["build", "x.000", "-o", "w"], "x.000: the chart cannot be read"),
])  # fmt: skip
def test_wrong_arguments_are_refused(arguments: list[str], output: str) -> None:
    with pytest.raises(ConfigError, match=output):
        command.main(arguments)


def test_a_resolution_that_is_too_fine_or_too_coarse_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"--resolution: 0.1 m makes .* nodes, more than"):
        command.main(["build", chart(tmp_path), "-o", str(tmp_path / "w"), "--resolution", "0.1"])
    with pytest.raises(ConfigError, match="--resolution: 5000 m is larger than the area: use "):
        command.main(["build", chart(tmp_path), "-o", str(tmp_path / "w"), "--resolution", "5000"])


def test_installed_and_own_worlds_are_listed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "400")
    command.main(["build", chart(tmp_path), "--resolution", "25", "-o", str(tmp_path / "own")])
    capsys.readouterr()
    assert command.main(["list", str(tmp_path)]) == 0
    output = capsys.readouterr().out
    for name in ("pool", "slope", "ridge", "fractal", "harbour", str(tmp_path / "own.toml")):
        assert name in output


@pytest.mark.usefixtures("own_process")
def test_an_interrupted_build_leaves_the_old_world(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = chart(tmp_path)
    command.main(["build", path, "--resolution", "25", "-o", str(tmp_path / "w")])
    before = {name: (tmp_path / name).read_bytes() for name in os.listdir(tmp_path)}

    def interrupt(share: float) -> None:
        if 0.0 < share < 1.0:
            raise KeyboardInterrupt

    monkeypatch.setattr(command, "show_progress", interrupt)
    with pytest.raises(KeyboardInterrupt):
        command.main(["build", path, "--resolution", "20", "-o", str(tmp_path / "w")])
    assert {name: (tmp_path / name).read_bytes() for name in os.listdir(tmp_path)} == before
