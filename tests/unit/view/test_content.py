"""What the page gets of a scenario: seabed, obstacles, water, vehicles, sensors, the places of a hunt."""

from array import array
from math import pi

import numpy as np
import pytest

from hil.autonomy.fleets.hunting import HuntPlan
from hil.view.live_view import MAX_POINTS, extend_track
from hil.view.scene.content import Hunt, SceneContent
from hil.view.scene.water import water_content
from hil.view.scene.world import MAX_NODES
from sim.environment.obstacles import Box, Cylinder
from sim.environment.terrain import Terrain
from sim.environment.terrain_grid import Grid
from sim.environment.world import World
from sim.sensors.sensor_set import read_sensors
from sim.vehicle.vehicle import load_vehicle
from tests.support.flights.paper_hunt import FORMATIONS, TARGET
from tests.unit.view.content_reader import read

POOL = World("pool", "", (0.0, 10.0, 0.0, 10.0), 4.0)


def relief(rows: int, columns: int) -> Terrain:
    depths = array("f", [5.0 + 0.01 * row + 0.002 * column for row in range(rows) for column in range(columns)])
    depths[3 * columns + 3] = float("nan")
    return Terrain(Grid(-10.0, 20.0, 1.0, rows, columns), depths, 9.0)


def test_a_seabed_keeps_its_depths_and_holes_with_a_limited_number_of_nodes() -> None:
    world = World("bay", "", (-10.0, 90.0, 20.0, 120.0), 9.0, terrain=relief(30, 30))
    header, depths, _ = read(SceneContent(world))
    assert (header["world"]["norths"], header["world"]["easts"]) == ([-10.0, 19.0], [20.0, 49.0])
    assert np.argwhere(np.isnan(depths)).tolist() == [[3, 3]]
    assert depths[10, 20] == pytest.approx(5.0 + 0.1 + 0.04, abs=1e-4)
    header, depths, _ = read(SceneContent(world._replace(terrain=relief(1001, 901))))
    assert max(depths.shape) <= MAX_NODES
    assert header["world"]["norths"][1] == -10.0 + 999.0
    assert depths[-1, 0] == pytest.approx(5.0 + 9.99, abs=1e-3)


def test_obstacles_stand_on_the_bed_and_end_at_the_surface() -> None:
    world = POOL._replace(
        current=(0.2, 0.0, 0.0), cylinder=(Cylinder(3.0, 4.0, 0.5),), box=(Box(6.0, 7.0, 1.0, 2.0, 0.25 * pi, 1.0),)
    )
    header, _, _ = read(SceneContent(world, path=[(1.0, 1.0), (2.0, 3.0, 3.5)], depth=2.0, goal=(5.0, 5.0)))
    pile, block = header["world"]["obstacles"]
    assert pile == {"north": 3.0, "east": 4.0, "top": -1.0, "bottom": 4.0, "radius": 0.5}
    assert (block["top"], block["bottom"], block["size"]) == (1.0, 4.0, [1.0, 2.0])
    assert block["heading"] == pytest.approx(0.25 * pi, abs=1e-5)
    assert header["path"] == [[1.0, 1.0, 2.0], [2.0, 3.0, 3.5]]
    assert header["goal"] == [5.0, 5.0, 2.0]
    assert header["world"]["current"] == [0.2, 0.0, 0.0]


def test_coastal_water_is_greener_and_darker_than_that_of_the_ocean() -> None:
    ocean, coast = (water_content(read_sensors({"camera": {"water": kind}}, "here")) for kind in ("I", "7C"))
    assert min(coast["attenuation"]) > 5.0 * max(ocean["attenuation"][1:])
    assert ocean["veil"][2] > ocean["veil"][1]
    assert coast["veil"][1] > coast["veil"][2]
    assert all(daylight > 0.0 for daylight in (*ocean["daylight"], *coast["daylight"]))


def test_vehicles_have_the_shape_of_their_file() -> None:
    files = {name: load_vehicle(name)[0] for name in ("bluerov2_heavy", "lauv")}
    header, depths, _ = read(SceneContent(vehicles=files))
    assert depths is None
    frame, torpedo = header["vehicles"]["bluerov2_heavy"], header["vehicles"]["lauv"]
    assert (frame["kind"], len(frame["thrusters"]), torpedo["kind"], len(torpedo["fins"])) == ("frame", 8, "torpedo", 4)
    first = files["bluerov2_heavy"].thrusters[0]
    assert frame["thrusters"][0]["position"] == list(first.position)
    assert frame["thrusters"][0]["direction"] == pytest.approx(first.unit_direction, abs=1e-4)
    assert frame["thrusters"][0]["diameter"] == pytest.approx(first.propeller_diameter, abs=1e-4)


def test_sensors_are_where_the_scenario_mounts_them() -> None:
    sections = {
        "camera": {"position": [0.3, 0.1, 0.2], "orientation": ["0 deg", "-30 deg", "90 deg"], "width": 400},
        "forward_sonar": {"sector": "90 deg", "max_range": 20},
    }
    header, _, _ = read(SceneContent(sensors=read_sensors(sections, "here")))
    camera, sonar = header["sensors"]["camera"], header["sensors"]["forward_sonar"]
    assert (camera["position"], camera["aspect"]) == ([0.3, 0.1, 0.2], pytest.approx(400 / 240, abs=1e-4))
    assert camera["attitude"][0] == pytest.approx(np.cos(-pi / 12) * np.cos(pi / 4), abs=1e-4)
    assert (sonar["width"], sonar["range"]) == (pytest.approx(0.5 * pi, abs=1e-4), 20.0)


def test_a_hunt_has_a_path_for_each_member_and_its_target() -> None:
    nodes, plan = ("a", "b", "c", "d"), HuntPlan(FORMATIONS["line"], TARGET, 1.5, 0.5)
    hunt = read(SceneContent(POOL, hunt=Hunt(nodes, plan, 5.0, 2.0)))[0]["hunt"]
    assert hunt["target"] == [*TARGET, 2.0]
    assert [path[0] for path in hunt["paths"].values()] == [[*place, 2.0] for place in FORMATIONS["line"]]
    assert np.hypot(*np.subtract(hunt["paths"]["a"][-1][:2], TARGET)) == pytest.approx(1.5, abs=1e-3), "on the ring"


def test_a_track_is_thinned_out_as_it_grows() -> None:
    track: list[tuple[float, float, float]] = []
    for number in range(3 * MAX_POINTS):
        extend_track(track, (0.06 * number, 0.0, 0.0))
    assert MAX_POINTS / 2 <= len(track) <= MAX_POINTS
    assert track[-1][0] == pytest.approx(0.06 * 3 * MAX_POINTS, abs=0.2)
