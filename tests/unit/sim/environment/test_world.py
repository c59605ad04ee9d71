"""Worlds: presets, clearance, walls, and the delivered path planning field."""

import os
from array import array
from itertools import pairwise, product
from math import cos, inf, pi, sin
from pathlib import Path

import pytest

from hil.common.errors import ConfigError
from hil.common.schema import preset_names
from sim.environment.obstacles import Box, Cylinder
from sim.environment.world import World, load_world
from sim.rays.scene import RayScene
from sim.rays.solids import sphere

EMPTY = World("sea", "test", (-10.0, 10.0, -20.0, 20.0), 30.0)


@pytest.mark.parametrize("name", preset_names("sim/worlds"))
def test_every_preset_loads(name: str) -> None:
    world = load_world(name)
    assert world.name == name
    assert world.source


def test_clearance_of_a_cylinder_is_the_distance_to_its_side() -> None:
    world = EMPTY._replace(cylinder=(Cylinder(3.0, 4.0, 2.0),))
    assert world.clearance(0.0, 0.0) == pytest.approx(3.0)
    assert world.clearance(3.0, 4.0) == -2.0
    assert world.clearance(3.0, 5.0) == -1.0
    assert EMPTY.clearance(0.0, 0.0) == inf
    assert len(world.within(3.0, 15.0, 9.1)) == len(world.within(-8.0, 4.0, 9.1)) == 1
    assert not world.within(3.0, 15.0, 8.9)
    assert not world.within(-8.0, 4.0, 8.9)


def test_clearance_of_a_turned_box_agrees_with_its_outline() -> None:
    """The clearance is that to the nearest of many points of its outline; the sign is by the box's own axes."""
    box = Box(1.0, -2.0, 4.0, 1.0, pi / 6)
    c, s = cos(box.heading), sin(box.heading)
    sides = [(4.0 * t, 0.5 * e) for t in [i / 400 - 0.5 for i in range(401)] for e in (-1, 1)]
    ends = [(2.0 * e, t) for t in [i / 400 - 0.5 for i in range(401)] for e in (-1, 1)]
    outline = [(1.0 + c * x - s * y, -2.0 + s * x + c * y) for x, y in sides + ends]
    for i in range(-4, 5):
        for j in range(-4, 5):
            north, east = 1.0 + 0.93 * i, -2.0 + 0.71 * j
            distance, out_north, out_east = box.separation(north, east)
            nearest = min((north - n) ** 2 + (east - e) ** 2 for n, e in outline) ** 0.5
            along, across = c * (north - 1.0) + s * (east + 2.0), c * (east + 2.0) - s * (north - 1.0)
            inside = abs(along) < 2.0 and abs(across) < 0.5
            assert distance == pytest.approx(-nearest if inside else nearest, abs=1e-3)
            assert out_north**2 + out_east**2 == pytest.approx(1.0)
            # a step along the way out gains just that much clearance
            assert box.separation(north + 0.01 * out_north, east + 0.01 * out_east)[0] == pytest.approx(distance + 0.01)


def test_only_obstacles_at_the_depth_count_for_clearance() -> None:
    world = EMPTY._replace(cylinder=(Cylinder(0.0, 0.0, 1.0, top=20.0), Cylinder(5.0, 0.0, 1.0)))
    assert world.clearance(0.0, 0.0) == -1.0
    assert world.clearance(0.0, 0.0, depth=19.0) == pytest.approx(4.0)
    assert world.clearance(0.0, 0.0, depth=21.0) == -1.0


def test_walls_bound_the_clearance() -> None:
    pool = EMPTY._replace(walls=True)
    assert pool.clearance(9.0, 0.0) == pytest.approx(1.0)
    assert pool.clearance(0.0, -18.0) == pytest.approx(2.0)
    assert pool.clearance(11.0, 0.0) == pytest.approx(-1.0)


BOUNDS = "extent = [0, 9, 0, 9]\ndepth = 30\n"
WAVES = "[ocean.waves]\nsignificant_height = 1\n"
SHAPE = "[[shape]]\nnorth = 0\neast = 0\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("extent = [0, 0, 0, 1]\ndepth = 5", "each pair growing"),
        ("extent = [0, 1, 0, 1]\ndepth = 5\n[[cylinder]]\nnorth = 2\neast = 0\nradius = 1", "(2, 0) is outside"),
        ("extent = [0, 9, 0, 9]\ndepth = 5\n[[cylinder]]\nnorth = 2\neast = 0\nradius = 1\ntop = 6", "in the seabed"),
        ("extent = [0, 9, 0, 9]\ndepth = 5\ncurrent = [0.1, 0.2]", "expected 3 values"),
        ('[bottom]\nkind = "snd"', "bottom: kind: 'snd' is not one of"),
        ("[ocean.layers]\ndepth = []", "ocean: layers: depth: give at least one"),
        ("[ocean.layers]\ndepth = [0, 5, 5]", "ocean: layers: depth: each must be greater"),
        ("[ocean.layers]\ndepth = [0, 5]\neast = [1]", "layers: east: expected 2 values, one for each depth, found 1"),
        ("[ocean.series]\ntime = [0, 5]\nnorth = [1]", "series: north: expected 2 values, one for each time"),
        ('[[ocean.tide]]\nconstituent = "M2"\namplitude = 1\nheading = "75"', "heading: has no unit"),
        ("[ocean.profile]\ndepth = [0, 9]\ndensity = [1020]", "density: expected 2 values, one for each depth, found"),
        ("[ocean.profile]\ndepth = [0, 9]\ndensity = []", "profile: density: give one value for each depth"),
        (
            "[ocean.profile]\ndepth = [9, 0]\ndensity = [1020, 1025]",
            "profile: depth: each must be greater than the",
        ),
        ("[ocean.waves]\nsignificant_height = 2.1\npeak_period = 3", "they would break; give a longer peak_period"),
        (f'{WAVES}peak_period = 6\ngamma = 2\nspectrum = "pierson_moskowitz"', "gamma is for jonswap"),
        (f'{WAVES}peak_period = "6 m"', "has the unit 'm'"),
        ("shape = 3", "shape: expected tables, each under [[shape]]"),
        (f'{SHAPE}kind = "net"\nmesh = 0.1\ntwine = 0.1', "shape[0]: twine is not thinner than mesh"),
        (f'{SHAPE}kind = "net_pen"\nmesh = 0.1\ntwine = 0.1', "shape[0]: twine is not thinner than mesh"),
        (f'{SHAPE}kind = "chain"\ndrop = 801', "shape[0]: 4005 links are more than 4000"),
    ],
)
def test_wrong_worlds_are_reported(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    bounds = "" if text.startswith("extent") else BOUNDS
    path.write_text(f'name = "mine"\nsource = "test"\n{bounds}{text}\n')
    with pytest.raises(ConfigError, match=r"mine\.toml") as caught:
        load_world(str(path))
    assert message in str(caught.value)


def is_reachable(world: World, margin: float, step: float = 0.5) -> bool:
    """Return whether there is a path from (0, 0) to (50, 50) with `margin` m of clearance."""
    count = round(50 / step)
    free = {
        (i, j) for i in range(count + 1) for j in range(count + 1) if world.clearance(i * step, j * step) >= margin
    }  # fmt: skip
    reached, edge = {(0, 0)}, [(0, 0)]
    while edge:
        i, j = edge.pop()
        for to in ((i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)):
            if to in free and to not in reached:
                reached.add(to)
                edge.append(to)
    return (count, count) in reached


def test_the_field_blocks_the_straight_line_and_has_a_path() -> None:
    field = load_world("paper_field")
    obstacles = (*field.cylinder, *field.box)
    assert 10 <= len(obstacles) <= 14
    assert field.cylinder
    assert field.box
    straight = [field.clearance(0.1 * i, 0.1 * i) for i in range(501)]
    assert min(straight) < -1.0
    assert sum(b < 0.0 <= a for a, b in pairwise(straight)) >= 4  # runs into four of them
    assert is_reachable(field, margin=1.0)
    assert not is_reachable(field, margin=4.0)


def test_obstacles_of_the_field_have_gaps_of_1_5_m() -> None:
    """From any point the distances to two obstacles add up to more than the gap between these."""
    obstacles = load_world("paper_field").obstacles()
    for i, j in product(range(101), repeat=2):
        nearest, next_one, *_ = sorted(one.separation(0.5 * i, 0.5 * j)[0] for one in obstacles)
        assert nearest + next_one >= 1.5


def test_an_obstacle_with_its_bottom_above_its_top_is_refused(tmp_path: Path) -> None:
    (tmp_path / "w.toml").write_text(
        'name = "w"\nsource = ""\nextent = [-5, 5, -5, 5]\ndepth = 9\n'
        "[[cylinder]]\nnorth = 1\neast = 2\nradius = 1\ntop = 3\nbottom = 2.5\n"
    )
    with pytest.raises(ConfigError, match=r"the obstacle at \(1, 2\) has its bottom above its top"):
        load_world(str(tmp_path / "w.toml"))


@pytest.fixture
def crowded_world(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Write the file of a world with many obstacles on a bed in a file; return its path."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    path = tmp_path / "crowded.toml"
    piles = [f"[[cylinder]]\nnorth = {i % 20}.0\neast = {i // 20}.0\nradius = 0.5\ntop = 8.0\n" for i in range(150)]
    (tmp_path / "bed.f32").write_bytes(array("f", [10.0] * 4).tobytes())
    bed = (
        '[terrain]\nfile = "bed.f32"\nnorth_min = -50.0\neast_min = -50.0\nresolution = 100.0\nrows = 2\ncolumns = 2\n'
    )
    path.write_text("\n".join([
        'name = "crowded"\nsource = "made"\nextent = [-50.0, 50.0, -50.0, 50.0]\ndepth = 10.0\n', bed, *piles,
        "[[box]]\nnorth = 30.0\neast = 1.0\nsize_north = 2.0\nsize_east = 3.0\nheading = 0.5\nname = 'pier'\n",
    ]))  # fmt: skip
    return path


def test_many_obstacles_are_validated_once(crowded_world: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = load_world(str(crowded_world))
    monkeypatch.setattr(World, "validate_obstacles", lambda self: pytest.fail("checked again"))
    second = load_world(str(crowded_world))
    assert (second.cylinder, second.box, second.extent) == (first.cylinder, first.box, first.extent)
    assert len(second.cylinder) == 150
    assert isinstance(second.cylinder[0], Cylinder)
    assert second.terrain is not None
    assert first.terrain is not None
    assert bytes(second.terrain.depths) == bytes(first.terrain.depths)


def test_many_obstacles_are_validated_again_when_a_file_changes(crowded_world: Path) -> None:
    load_world(str(crowded_world))
    bed = crowded_world.with_name("bed.f32")
    bed.write_bytes(array("f", [6.0] * 4).tobytes())
    os.utime(bed, ns=(1, 1))
    with pytest.raises(ConfigError, match="has its top in the seabed"):
        load_world(str(crowded_world))
    bed.write_bytes(array("f", [10.0] * 4).tobytes())
    crowded_world.write_text(crowded_world.read_text() + "[[cylinder]]\nnorth = 80.0\neast = 0.0\nradius = 1.0\n")
    with pytest.raises(ConfigError, match="is outside the extent"):
        load_world(str(crowded_world))


def test_objects_added_to_one_scene_are_not_in_another(crowded_world: Path) -> None:
    world = load_world(str(crowded_world))
    scene, other = RayScene(world), RayScene(world)
    ball = other.add(sphere((0.0, 40.0, 5.0), 1.0))
    assert ball == len(world.obstacles()) + 1
    away = array("d", (0.0, 1.0, 0.0))
    assert other.hits((0.0, 30.0, 5.0), away, 50.0).objects[0] == ball
    assert scene.hits((0.0, 30.0, 5.0), away, 50.0).objects[0] != ball, (
        "an object added to one scene is not in the other"
    )
    north = array("d", (1.0, 0.0, 0.0))
    assert scene.hits((25.0, 1.0, 5.0), north, 50.0).objects[0] == 151
