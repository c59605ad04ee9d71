"""Kinds of seabed by position: how files are read, what sonars and cameras make of them, and invalid files."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim.dynamics import State
from sim.environment.bottom import PROPERTIES, Bottom
from sim.environment.things.bottom_map import _BORDER_WAVES
from sim.environment.things.natures import NATURES
from sim.environment.world import World, load_world
from sim.sensors.imaging.camera.model import CameraModel
from sim.sensors.imaging.camera.sensor import Camera
from sim.sensors.imaging.forward_sonar import ForwardSonar, ForwardSonarModel
from sim.sensors.mounting import Mounting
from sim.sensors.ranging.profiler import Profiler, ProfilerModel
from sim.simulation import Simulation
from sim.vehicle.vehicle import load_vehicle

VEHICLE, _ = load_vehicle("bluerov2_heavy")
HEAD = 'name = "w"\nsource = ""\nextent = [-60, 60, -60, 60]\ndepth = 12\n'
KEYS = 'file = "w.bottom"\nnorth_min = -50\neast_min = -50\nresolution = 50\nrows = 3\ncolumns = 3\n'
FINE_KEYS = 'file = "w.bottom"\nnorth_min = -60\neast_min = -60\nresolution = 2\nrows = 61\ncolumns = 86\n'
MUD_THEN_ROCK = 61 * (43 * [1] + 43 * [9])  # from 25 m east on


def world_of(folder: Path, codes: list[int], text: str = "", keys: str = KEYS) -> World:
    (folder / "w.bottom").write_bytes(bytes(codes))
    (folder / "w.toml").write_text(f"{HEAD}{text}[bottom_map]\n{keys}")
    return load_world(str(folder / "w.toml"))


def test_near_a_node_its_kind_applies_and_none_is_known_off_the_map(tmp_path: Path) -> None:
    kinds = world_of(tmp_path, [1, 2, 3, 4, 0, 6, 7, 8, 9]).bottom_map
    assert kinds is not None
    north, east = np.array([-50.0, -50.0, 5.0, 0.0, 74.0, 76.0]), np.array([-50.0, -43.0, 46.0, 0.0, 74.0, 0.0])
    assert kinds.codes(north, east).tolist() == [1, 1, 6, 0, 9, 0]
    times = kinds.echoes(north, east, None)
    mud, gravel, rock = (PROPERTIES[kind].echo for kind in ("mud", "gravel", "rock"))
    assert 10.0 * np.log10(times) == pytest.approx([mud, mud, gravel, 0.0, rock, 0.0], abs=1e-5)
    on_mud = kinds.echoes(north, east, Bottom("mud"))
    assert 10.0 * np.log10(on_mud) == pytest.approx([0.0, 0.0, gravel - mud, 0.0, rock - mud, 0.0], abs=1e-5)
    assert {name: NATURES[name].echo for name in PROPERTIES} == {n: p.echo for n, p in PROPERTIES.items()}


def test_a_border_is_the_line_of_equal_weight_and_ragged(tmp_path: Path) -> None:
    """A straight border between two columns of nodes; it stays between them, and has no step of a node."""
    kinds = world_of(tmp_path, [1, 1, 4, 1, 1, 4, 1, 1, 4]).bottom_map
    assert kinds is not None
    north, east = np.meshgrid(np.arange(-50.0, 50.0, 0.25), np.arange(0.0, 50.0, 0.25), indexing="ij")
    sand = kinds.codes(north, east) == 4
    border = 50.0 - 0.25 * sand.sum(axis=1)
    assert border.mean() == pytest.approx(25.0, abs=3.0)
    assert 2.0 < border.std() < 10.0, "of nodes 50 m apart"
    assert not sand[:, :10].any()
    assert sand[:, -10:].all()
    assert np.abs(np.diff(border)).max() < 5.0


@pytest.mark.parametrize(("rows", "columns"), [(1, 1), (1, 4), (3, 1), (4, 3)])
@pytest.mark.parametrize("kinds", [[4], [0, 1, 4, 9, 17]], ids=["one kind", "mixed"])
def test_the_kind_with_the_largest_bilinear_weight_applies(
    tmp_path: Path, rows: int, columns: int, kinds: list[int]
) -> None:
    """The waves of borders change weights, by a factor of each kind. The map reaches half a cell beyond its nodes."""
    chance = np.random.default_rng(7)
    grid = chance.choice(kinds, (rows, columns))

    def expected(x: float, y: float) -> int:
        if not (-0.5 <= x < rows - 0.5 and -0.5 <= y < columns - 0.5):
            return 0
        x, y = np.clip(x, 0, rows - 1), np.clip(y, 0, columns - 1)
        weights = np.outer(*(np.clip(1.0 - abs(np.arange(n) - at), 0.0, 1.0) for n, at in ((rows, x), (columns, y))))
        waves = sum(size * np.sin(2.0 * np.pi * (a * x + b * y)) for size, a, b in _BORDER_WAVES)
        shares = {code: weights[grid == code].sum() for code in kinds}
        return max(kinds, key=lambda code: shares[code] + np.sin(2.4 * code) * waves * (shares[code] > 0.0))

    keys = f'file = "w.bottom"\nnorth_min = 8\neast_min = -3\nresolution = 4\nrows = {rows}\ncolumns = {columns}\n'
    bottom_map = world_of(tmp_path, grid.ravel().tolist(), keys=keys).bottom_map
    assert bottom_map is not None
    nodes, within = np.argwhere(grid >= 0), chance.uniform(-0.9, (rows - 0.1, columns - 0.1), (300, 2))
    places = np.concatenate([within, nodes - 0.5, nodes, nodes + 0.5])
    norths, easts = 8.0 + 4.0 * places[:, 0], -3.0 + 4.0 * places[:, 1]
    codes = [expected(x, y) for x, y in places]
    assert bottom_map.codes(norths, easts).tolist() == codes
    assert [bottom_map.code(north, east) for north, east in zip(norths.tolist(), easts.tolist(), strict=True)] == codes
    assert bottom_map.codes(norths[:0], easts[:0]).size == 0


def test_a_sonar_receives_more_from_rock_than_from_mud(tmp_path: Path) -> None:
    """The bed ahead to port is mud, to starboard rock; the true picture has means alone."""
    world = world_of(tmp_path, MUD_THEN_ROCK, keys=FINE_KEYS)
    model = ForwardSonarModel(ground_truth=True, beams=64, max_range=40.0, surface_strength=-200.0, side_lobes=0.0)
    sonar = ForwardSonar(model, Mounting(), 1, Simulation(VEHICLE, world, {}, position=(0.0, 25.0, 8.0)))
    sample = sonar.sample(0, State((0.0, 25.0, 8.0)))
    echoes = np.frombuffer(sample.intensities, np.float32).reshape(sample.bins, 64)
    port, starboard = (echoes[250:300, part].sum() for part in (slice(4, 24), slice(40, 60)))
    apart = PROPERTIES["rock"].echo - PROPERTIES["mud"].echo
    assert 10.0 * np.log10(starboard / port) == pytest.approx(apart, abs=0.5)


@pytest.mark.parametrize("width", [0.0, 0.02])
def test_a_profiler_measures_the_seabed_kind_below_each_beam(tmp_path: Path, width: float) -> None:
    """The bed to port is mud, to starboard rock; its strengths are without the cosine of the other side."""
    world = world_of(tmp_path, MUD_THEN_ROCK, keys=FINE_KEYS)
    scene = Simulation(VEHICLE, world, {}, position=(0.0, 25.0, 2.0))
    profiler = Profiler(ProfilerModel(ground_truth=True, beams=41, beam_width=width), Mounting(), 1, scene)
    strengths = profiler.sample(0, State((0.0, 25.0, 2.0))).intensities
    apart = PROPERTIES["rock"].echo - PROPERTIES["mud"].echo
    for beam in range(5, 20):
        assert strengths[40 - beam] - strengths[beam] == pytest.approx(apart, abs=0.01)


def test_a_camera_shows_the_colours_of_the_kinds(tmp_path: Path) -> None:
    model = CameraModel(ground_truth=True, width=41, height=31, exposure=1.0)
    down = Mounting(orientation=(0.0, -0.5 * np.pi, 0.0))

    def take(world: World) -> Any:
        camera = Camera(model, down, 1, Simulation(VEHICLE, world, {}, position=(0.0, 0.0, 8.0)))
        return camera._renderer.render(0, State((0.0, 0.0, 8.0)))[0]

    plain = take(World("w", "", (-60.0, 60.0, -60.0, 60.0), 12.0))
    grain = plain / NATURES["sand"].colour - 1.0
    assert take(world_of(tmp_path, [0] * 9)) == pytest.approx(plain, rel=1e-3), "of an unknown kind"
    for kind in ("sand", "mud", "shells"):
        expected = np.maximum(0.1, 1.0 + grain * NATURES[kind].texture) * NATURES[kind].colour
        assert take(world_of(tmp_path, [NATURES[kind].code] * 9)) == pytest.approx(expected, rel=1e-3)
