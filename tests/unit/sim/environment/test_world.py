from itertools import pairwise
from math import cos, inf, pi, sin
from pathlib import Path

import pytest

from hil.common.errors import ConfigError
from hil.common.schema import preset_names
from sim.environment.obstacles import Box, Cylinder
from sim.environment.world import World, load_world

EMPTY = World("sea", "test", (-10.0, 10.0, -20.0, 20.0), 30.0)


@pytest.mark.parametrize("name", preset_names("sim/worlds"))
def test_every_preset_loads(name: str) -> None:
    world = load_world(name)
    assert world.name == name
    assert world.source


def test_clearance_of_a_cylinder() -> None:
    world = EMPTY._replace(cylinder=(Cylinder(3.0, 4.0, 2.0),))
    assert world.clearance(0.0, 0.0) == pytest.approx(3.0)
    assert world.clearance(3.0, 4.0) == -2.0
    assert world.clearance(3.0, 5.0) == -1.0
    assert EMPTY.clearance(0.0, 0.0) == inf


def test_clearance_of_a_turned_box_against_its_outline() -> None:
    """The nearest of many points of its outline, at many places; the sign by the box's own axes."""
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


def test_only_what_reaches_up_counts() -> None:
    world = EMPTY._replace(cylinder=(Cylinder(0.0, 0.0, 1.0, top=20.0), Cylinder(5.0, 0.0, 1.0)))
    assert world.clearance(0.0, 0.0) == -1.0
    assert world.clearance(0.0, 0.0, depth=19.0) == pytest.approx(4.0)
    assert world.clearance(0.0, 0.0, depth=21.0) == -1.0


def test_walls() -> None:
    pool = EMPTY._replace(walls=True)
    assert pool.clearance(9.0, 0.0) == pytest.approx(1.0)
    assert pool.clearance(0.0, -18.0) == pytest.approx(2.0)
    assert pool.clearance(11.0, 0.0) == pytest.approx(-1.0)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("extent = [0, 0, 0, 1]\ndepth = 5", "each pair growing"),
        ("extent = [0, 1, 0, 1]\ndepth = 5\n[[cylinder]]\nnorth = 2\neast = 0\nradius = 1", "(2, 0) is outside"),
        ("extent = [0, 9, 0, 9]\ndepth = 5\n[[cylinder]]\nnorth = 2\neast = 0\nradius = 1\ntop = 6", "in the seabed"),
        ("extent = [0, 9, 0, 9]\ndepth = 5\n[[cylinder]]\nnorth = 2\neast = 0\nradios = 1", "did you mean 'radius'"),
        ("extent = [0, 9, 0, 9]\ndepth = 5\ncurrent = [0.1, 0.2]", "expected 3 values"),
    ],
)
def test_wrong_worlds_are_named(text: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(f'name = "mine"\nsource = "test"\n{text}\n')
    with pytest.raises(ConfigError, match=r"mine\.toml") as caught:
        load_world(str(path))
    assert words in str(caught.value)


def reachable(world: World, margin: float, step: float = 0.5) -> bool:
    """Is there a way from (0, 0) to (50, 50) that keeps `margin` m of clearance?"""
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


def test_the_field_is_a_problem_with_a_solution() -> None:
    field = load_world("paper_field")
    obstacles = (*field.cylinder, *field.box)
    assert 10 <= len(obstacles) <= 14
    assert field.cylinder
    assert field.box
    straight = [field.clearance(0.1 * i, 0.1 * i) for i in range(501)]
    assert min(straight) < -1.0
    assert sum(b < 0.0 <= a for a, b in pairwise(straight)) >= 4  # runs into four of them
    assert reachable(field, margin=1.0)
    assert not reachable(field, margin=4.0)


def test_gaps_of_the_field() -> None:
    """Between any two obstacles there are 1.5 m or more."""
    field = load_world("paper_field")
    obstacles = field.obstacles()
    for one in field.cylinder:
        for other in obstacles:
            assert other is one or other.separation(one.north, one.east)[0] - one.radius >= 1.5
    for box in field.box:
        c, s = cos(box.heading), sin(box.heading)
        for t in [i / 20 - 0.5 for i in range(21)]:
            for x, y in ((t, 0.5), (t, -0.5), (0.5, t), (-0.5, t)):
                along, across = x * box.size_north, y * box.size_east
                at = box.north + c * along - s * across, box.east + s * along + c * across
                assert all(other.separation(*at)[0] >= 1.5 for other in obstacles if other is not box)


def test_a_thing_ends_below_its_top(tmp_path: Path) -> None:
    (tmp_path / "w.toml").write_text(
        'name = "w"\nsource = ""\nextent = [-5, 5, -5, 5]\ndepth = 9\n'
        "[[cylinder]]\nnorth = 1\neast = 2\nradius = 1\ntop = 3\nbottom = 2.5\n"
    )
    with pytest.raises(ConfigError, match=r"the obstacle at \(1, 2\) has its bottom above its top"):
        load_world(str(tmp_path / "w.toml"))
