"""Parametric shapes: sizes and positions, nets that rays pass and vehicles do not, chains, and wrong keys."""

import itertools
from collections import Counter
from math import hypot, inf, radians
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hil.scenario.world_map import map_at
from sim.dynamics import Dynamics, State
from sim.environment.collision import Contact
from sim.environment.things.primitives import hanging, links
from sim.environment.things.shapes import HANGS, KINDS, Rope
from sim.environment.world import World, load_world
from sim.rays.scene import RayScene
from sim.vehicle.vehicle import load_vehicle

VEHICLE, _ = load_vehicle("paper_six")
HEAD = 'name = "w"\nsource = ""\nextent = [-50, 50, -50, 50]\ndepth = 20\n'


def world_of(folder: Path, text: str) -> World:
    (folder / "w.toml").write_text(HEAD + text)
    return load_world(str(folder / "w.toml"))


def corners(world: World) -> Any:
    return np.array([corner for mesh in world.mesh for corner in mesh.corners()])


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_stands_on_the_bed_or_hangs_from_the_surface(tmp_path: Path, kind: str) -> None:
    places = corners(world_of(tmp_path, f'[[shape]]\nkind = "{kind}"\nnorth = 10\neast = -5\n'))
    assert np.isfinite(places).all()
    low, high = places.min(axis=0), places.max(axis=0)
    assert low[0] - 0.5 <= 10.0 <= high[0] + 0.5
    if kind in HANGS:
        assert -0.5 < low[2] < 0.5
    else:
        assert high[2] == pytest.approx(20.0, abs=0.02), "its foot is on the bed"


@pytest.mark.parametrize(
    ("text", "size"),
    [
        ('kind = "pipe"\nlength = 8\ndiameter = 1.0\nsides = 64', (8.0, 1.0, 1.0)),
        ('kind = "pipe"\nlength = 8\ndiameter = 1.0\nsides = 64\nscale = 0.5', (4.0, 0.5, 0.5)),
        ('kind = "pile"\nheight = 6\ndiameter = 2.0\nsides = 64', (2.0, 2.0, 6.0)),
        ('kind = "net"\nwidth = 10\nheight = 4\norientation = [0, 0, "90 deg"]', (0.02, 10.0, 4.01)),
        ('kind = "net_pen"\ndiameter = 20\nheight = 9\ncollar = 0.1', (20.5, 20.5, 9.07)),
        ('kind = "box_wreck"\nlength = 30\nwidth = 8\nheight = 5', (30.0, 8.0, 12.0)),
        ('kind = "chain"\ndrop = 8\nbar = 0.1', (0.36, 0.36, 8.0)),
        ('kind = "rope"\ndrop = 8\nspan = 6\ndiameter = 0.02', (6.0, 0.02, 8.0)),
    ],
)
def test_shapes_have_the_sizes_of_their_keys(tmp_path: Path, text: str, size: tuple[float, ...]) -> None:
    places = corners(world_of(tmp_path, f"[[shape]]\n{text}\nnorth = 0\neast = 0\n"))
    assert np.ptp(places, axis=0) == pytest.approx(size, abs=0.25 if "chain" in text else 0.12)


def test_a_chain_hangs_as_a_catenary_and_lies_at_the_depth_of_its_end() -> None:
    line = hanging(30.0, 5.0, 40.0, 4001)
    assert line[-1] == pytest.approx((30.0, 0.0, 5.0), abs=1e-6)
    free = hanging(20.0, -10.0, 23.0, 4001)  # its end is so far above its start that no part lies on the bed
    length = sum(hypot(b[0] - a[0], b[2] - a[2]) for a, b in itertools.pairwise(free))
    assert length == pytest.approx(23.0, rel=1e-4)
    assert hanging(3.0, 4.0, 4.9, 5)[1] == (0.75, 0.0, 1.0), "taut"
    assert max(down for _, _, down in line) == pytest.approx(5.0), "it lies"
    level = hanging(20.0, 0.0, 20.5, 4001)
    assert all(down == 0.0 for _, _, down in level), "its ends are on the level that it lies on"
    steep = hanging(0.8, 3.2, 3.4, 4001)
    length = sum(hypot(b[0] - a[0], b[2] - a[2]) for a, b in itertools.pairwise(steep))
    assert length == pytest.approx(3.4, rel=1e-4)
    slopes = [(b[2] - a[2]) / (b[0] - a[0]) for a, b in itertools.pairwise(steep)]
    assert slopes == sorted(slopes, reverse=True), "steepest above"


def test_a_rope_is_a_closed_tube() -> None:
    rope = Rope(6.0, -8.0, 11.0, 0.03, sides=6).parts()[0].triangles
    assert set(Counter(frozenset((t[k - 1], t[k])) for t in rope for k in range(3)).values()) == {2}
    a, b, c = np.array(rope).transpose(1, 0, 2)
    assert 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() == pytest.approx(6.0 * 0.015 * 11.0, rel=2e-3), (
        "and its ends"
    )


def test_a_chain_has_the_same_links_along_any_line() -> None:
    """They are 6 bars long and 3.6 wide, every other one turned. A bend does not change their distance."""
    hanging_down = np.array(links([(1.0, 2.0, 3.0), (1.0, 2.0, 13.0)], 0.1)).reshape(25, -1, 3) - (1.0, 2.0, 3.0)
    inclined = links([(1.0, 2.0, 3.0)] * 2 + [(4.0, 2.0, 7.0), (7.0, 2.0, 11.0)], 0.1)
    turned = hanging_down @ np.array([[0.8, 0.0, -0.6], [0.0, 1.0, 0.0], [0.6, 0.0, 0.8]])
    assert np.array(inclined).reshape(25, -1, 3) - (1.0, 2.0, 3.0) == pytest.approx(turned)
    sizes, middles = np.ptp(hanging_down, axis=1), hanging_down.mean(axis=1)
    assert sizes[::2] == pytest.approx(np.tile([0.36, 0.1, 0.6], (13, 1)), abs=0.035)
    assert sizes[1::2] == pytest.approx(np.tile([0.1, 0.36, 0.6], (12, 1)), abs=0.035)
    assert middles == pytest.approx(np.outer(np.arange(25) + 0.5, (0.0, 0.0, 0.4)))


def test_rays_pass_a_net_in_the_share_of_its_openings(tmp_path: Path) -> None:
    net = 'kind = "net"\nnorth = 5\neast = -10\nwidth = 20\nheight = 10\norientation = [0, 0, "90 deg"]\nmesh = 0.05\n'
    world = world_of(tmp_path, f"[[shape]]\n{net}twine = 0.01\n")
    chance = np.random.default_rng(1)
    toward = np.column_stack([np.full(20_000, 5.0), chance.uniform(-4.0, 4.0, 20_000), chance.uniform(-3, 3, 20_000)])
    rays = (toward / np.linalg.norm(toward, axis=1)[:, None]).ravel()
    is_hit = np.isfinite(np.array(RayScene(world).ranges((0.0, 0.0, 5.0), rays, 9.0)))
    assert is_hit.mean() == pytest.approx(1.0 - 0.8**2, abs=0.01)
    again = RayScene(world).hits((0.0, 0.0, 5.0), rays, 9.0)
    assert np.array(again.points).reshape(-1, 3)[is_hit][:, 0] == pytest.approx(5.0, abs=1e-6)


def test_a_net_pen_has_a_bottom_with_the_same_lattice(tmp_path: Path) -> None:
    pen = 'kind = "net_pen"\nnorth = 0\neast = 0\nmesh = 0.05\ntwine = 0.005\n'
    world = world_of(tmp_path, f"[[shape]]\n{pen}")
    chance = np.random.default_rng(2)
    toward = np.column_stack([chance.uniform(-5.0, 5.0, (20_000, 2)), np.full(20_000, 5.0)])
    rays = (toward / np.linalg.norm(toward, axis=1)[:, None]).ravel()
    met = np.isfinite(np.array(RayScene(world).ranges((0.3, 0.2, 5.0), rays, 9.0)))
    assert met.mean() == pytest.approx(1.0 - 0.9**2, abs=0.01)


def test_a_vehicle_does_not_pass_through_a_net(tmp_path: Path) -> None:
    net = 'kind = "net"\nnorth = 5\neast = -10\nwidth = 20\nheight = 10\norientation = [0, 0, "90 deg"]\nmesh = 0.4\n'
    world = world_of(tmp_path, f'[[shape]]\n{net}name = "the net"\n')
    contact = Contact(VEHICLE, world, Dynamics(VEHICLE, 1025.0, 9.8).inverse_mass)
    state = State((3.0, 0.03, 5.03))
    for _ in range(600):
        state.nu = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]
        state.position = [state.position[0] + 0.005, *state.position[1:]]
        contact.resolve(state)
    assert contact.what == "the net"
    assert state.position[0] < 5.0
    level = map_at(world, 5.0, 0.3, 0.25)
    assert not level.line_is_free((0.0, 0.0), (10.0, 0.0))
    assert map_at(world, 12.0, 0.3, 0.25).line_is_free((0.0, 0.0), (10.0, 0.0)), "it is 10 m high"


def test_a_wreck_has_its_attitude_and_an_open_hold(tmp_path: Path) -> None:
    wreck = '[[shape]]\nkind = "box_wreck"\nnorth = 0\neast = 0\norientation = [0, 0, 1.5708]\ncolour = [0, 0.1, 1]\n'
    world = world_of(tmp_path, wreck)
    assert world.mesh[0].keys.colour == (0.0, 0.1, 1.0)
    assert np.ptp(corners(world), axis=0)[1] == pytest.approx(24.0, abs=0.01)
    down = np.array([0.0, 0.0, 1.0])
    hold, deck = (RayScene(world).ranges((0.0, east, 10.0), down, 30.0)[0] for east in (2.0, 5.2))
    assert (hold, deck) == pytest.approx((10.0, 6.0), abs=0.01), "to its keel, and to the deck"
    assert RayScene(world).ranges((0.0, 0.0, 3.0), down, radians(1.0))[0] == inf
