"""Pipelines and cables: rays, contact and planners on flat beds and on relief."""

from math import hypot, inf
from pathlib import Path

import numpy as np
import pytest

from hil.common.errors import ConfigError
from hil.scenario.world_map import map_at
from sim.dynamics import Dynamics, State
from sim.environment.collision import Contact
from sim.environment.relief import Sinusoid, Slope
from sim.environment.terrain import Terrain, covering
from sim.environment.things.pipelines import Pipeline
from sim.environment.world import World, load_world
from sim.rays.scene import SEABED, RayScene
from sim.sensors.imaging.scenery import Scenery
from sim.vehicle.vehicle import load_vehicle

VEHICLE, _ = load_vehicle("paper_six")
EXTENT = (-200.0, 200.0, -200.0, 200.0)
FLAT = World("flat", "test", EXTENT, 20.0, pipeline=(Pipeline(((-100.0, 0.0), *((0.0, 0.0),) * 2, (50.0, 50.0)), 1.0),))
DOWN = np.array([0.0, 0.0, 1.0])


def test_a_pipeline_lies_on_the_bed_and_is_round() -> None:
    scene = RayScene(FLAT)
    for east in (0.0, 0.2, -0.4):
        assert scene.ranges((-50.0, east, 10.0), DOWN, 50.0)[0] == pytest.approx(9.5 - (0.25 - east**2) ** 0.5)
    hits = scene.hits((-50.0, 0.6, 10.0), DOWN, 50.0)
    assert (hits.distances[0], hits.objects[0]) == (10.0, SEABED)
    bend = scene.hits((25.0, 25.0, 10.0), DOWN, 50.0)
    assert bend.objects[0] == 1
    assert bend.distances[0] == pytest.approx(9.0)
    assert scene.ranges((60.0, 60.0, 10.0), DOWN, 50.0)[0] == 10.0, "beyond its end"
    far = RayScene(FLAT._replace(pipeline=(Pipeline(((-100.0, 150.0), (100.0, 150.0)), 1.0),)))
    assert far.ranges((0.0, 150.0, 10.0), DOWN, 12.0)[0] == pytest.approx(9.0)


def test_a_pipeline_is_one_object_and_added_objects_keep_their_numbers() -> None:
    from sim.rays.solids import sphere

    scene = RayScene(FLAT)
    number = scene.add(sphere((-70.0, 0.0, 5.0), 1.0))
    assert number == 2
    for north in (-95.0, -70.0, -5.0, 150.0, -70.0):
        down = scene.hits((north, min(north, 0.0) * 0.0, 2.0), DOWN, 30.0)
        wanted = number if north == -70.0 else 1 if north < 0.0 else SEABED
        assert down.objects[0] == wanted, north


@pytest.mark.parametrize("height", [0.0, -0.3, 2.0])
def test_a_pipeline_follows_relief_buried_or_raised(height: float) -> None:
    terrain = Terrain(covering(EXTENT, 2.0), Sinusoid(15.0, 2.0, 60.0).depths(covering(EXTENT, 2.0)), 15.0)
    pipe = Pipeline(((-150.0, 3.0), (150.0, 3.0)), 0.6, height)
    scene = RayScene(FLAT._replace(terrain=terrain, pipeline=(pipe,)))
    for north in np.arange(-140.0, 140.0, 7.3):
        found = scene.ranges((north, 3.0, 5.0), DOWN, 30.0)[0] + 5.0
        assert found == pytest.approx(terrain.depth(north, 3.0) - height - 0.6, abs=0.06)


def test_pipelines_buried_or_on_land_are_not_hit() -> None:
    terrain = Terrain(covering(EXTENT, 5.0), Slope(0.0, 0.2).depths(covering(EXTENT, 5.0)), 15.0)  # land in the south
    pipe = Pipeline(((-150.0, 0.0), (150.0, 0.0)), 1.0)
    assert all(end[2] > -1.0 for piece in pipe.pieces(terrain.depth, 5.0) for end in piece)
    assert min(one[0] for one, _ in pipe.pieces(terrain.depth, 5.0)) == pytest.approx(5.0)
    buried = FLAT._replace(pipeline=(pipe._replace(height=-1.0),))
    assert RayScene(buried).hits((0.0, 0.0, 10.0), DOWN, 50.0).objects[0] == SEABED


def test_a_route_follows_a_pipeline_at_an_altitude() -> None:
    route = FLAT.pipeline[0].route(FLAT.seabed, 10.0, altitude=2.0)
    assert route[0] == pytest.approx((-100.0, 0.0, 17.5))
    assert route[-1] == pytest.approx((50.0, 50.0, 17.5))
    steps = np.linalg.norm(np.diff(np.array(route), axis=0), axis=1)
    assert 8.0 < steps.min() <= steps.max() <= 10.0


def test_only_the_near_part_of_a_long_pipeline_is_computed() -> None:
    requested: list[float] = []

    def seabed(north: float, _: float) -> float:
        requested.append(north)
        return 20.0

    cable = Pipeline(((-50_000.0, 0.0), (50_000.0, 0.0)), 0.1, kind="cable")
    segments = list(cable.pieces(seabed, 5.0, 1000.0, 3.0, 60.0))
    assert len(requested) < 40
    assert min(one[0] for one, _ in segments) <= 940.0
    assert max(other[0] for _, other in segments) >= 1060.0


def test_a_pipeline_is_an_obstacle_only_near_the_bed() -> None:
    world = FLAT._replace(pipeline=(Pipeline(((-100.0, 0.0), (100.0, 0.0)), 2.0, name="outfall"),))
    contact = Contact(VEHICLE, world, Dynamics(VEHICLE, 1025.0, 9.8).inverse_mass)
    state = State((3.0, -4.0, 19.0), (2.0**-0.5, 0.0, 0.0, 2.0**-0.5))
    for _ in range(800):
        state.nu = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]
        state.position = [state.position[0], state.position[1] + 0.005, state.position[2]]
        contact.resolve(state)
    assert contact.what == "outfall"
    assert state.position[1] < 0.0
    assert not contact.resolve(State((3.0, 0.0, 16.0)))
    assert not map_at(world, 19.0, 0.3, 0.5).line_is_free((0.0, -10.0), (0.0, 10.0))
    assert map_at(world, 15.0, 0.3, 0.5).line_is_free((0.0, -10.0), (0.0, 10.0))
    assert world.clearance(0.0, 5.0, 19.0, height=0.5) == pytest.approx(4.0)
    assert world.clearance(0.0, 5.0, 10.0, height=0.5) == inf
    assert world.clearance(0.0, 5.0) == pytest.approx(4.0)


def test_a_distant_pipeline_gives_the_free_distance_to_it() -> None:
    contact = Contact(VEHICLE, FLAT, Dynamics(VEHICLE, 1025.0, 9.8).inverse_mass)
    assert not contact.resolve(State((0.0, -150.0, 19.0)))
    assert 140.0 < contact.clearance()[2] < 150.0
    assert FLAT.pipeline[0].separation(30.0, 10.0) == pytest.approx((200.0**0.5 - 0.5, 0.5**0.5, -(0.5**0.5)))
    assert FLAT.pipeline[0].separation(-50.0, 0.0) == (-0.5, 1.0, 0.0)


def test_a_pipeline_down_a_slope_is_an_obstacle_at_the_depths_of_its_pieces() -> None:
    """From node to node its axis falls from 9 m to 14 m and to 19 m."""
    pipe = Pipeline(((0.0, 0.0), (20.0, 0.0)), 2.0)
    bed = lambda north, _: 10.0 + 0.5 * north  # noqa: E731
    assert pipe.distance(bed, 10.0, 0.0, 5.0, 15.5, 16.0, 10.3) == pytest.approx(hypot(10.0, 5.0) - 1.0)
    assert pipe.distance(bed, 10.0, 0.0, 5.0, 15.5, 16.0, 8.0) == inf
    assert [(stretch.top, stretch.bottom) for stretch in pipe.stretches(bed, 10.0, 0.0, 0.0, 5.0)] == [(7.0, inf)]


def test_cameras_and_sonars_use_colour_and_echo_of_a_pipeline() -> None:
    world = FLAT._replace(pipeline=(FLAT.pipeline[0]._replace(colour=(0.9, 0.1, 0.2), echo=5.0),))
    assert list(world.appearances()) == [(1, (0.9, 0.1, 0.2), 5.0)]
    assert Scenery(world, 2).colours[1] == pytest.approx((0.9, 0.1, 0.2))


def test_a_world_file_can_have_pipelines(tmp_path: Path) -> None:
    head = 'name = "w"\nsource = ""\nextent = [-50, 50, -50, 50]\ndepth = 30\n'
    (tmp_path / "w.toml").write_text(head + '[[pipeline]]\npoints = [[0, 0], ["10 m", 5]]\nkind = "cable"\n')
    (pipe,) = load_world(str(tmp_path / "w.toml")).pipeline
    assert (pipe.kind, pipe.points, pipe.label) == ("cable", ((0.0, 0.0), (10.0, 5.0)), "the cable from (0, 0)")
    assert load_world(str(tmp_path / "w.toml")).obstacles() == (pipe,)
    for text, output in (
        ("[[pipeline]]\npoints = [[0, 0]]\n", "points: give two or more"),
        ("[[pipeline]]\npoints = [[0, 0], [1]]\n", r"pipeline\[0\]: points"),
        ("pipeline = 3\n", r"pipeline: expected tables, each under \[\[pipeline\]\]"),
    ):
        (tmp_path / "w.toml").write_text(head + text)
        with pytest.raises(ConfigError, match=output):
            load_world(str(tmp_path / "w.toml"))


def test_coarse_map_cells_are_occupied_by_any_part_of_a_pipeline() -> None:
    """A thick pipeline reaches 0.2 m into cells of 2 m with its edge, not to their middles."""
    world = FLAT._replace(pipeline=(Pipeline(((-100.0, 0.0), (100.0, 0.0)), 4.4),))
    coarse = map_at(world, 18.5, 0.5, 2.0, is_coarse=True)
    assert not any(coarse.is_free((north, east)) for north in (-51.0, 9.0) for east in (-3.0, -1.0, 1.0, 3.0))
    assert coarse.is_free((9.0, 5.0))
