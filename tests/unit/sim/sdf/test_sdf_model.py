"""Import of Gazebo's SDF: frames resolved, plugin values in our signs and axes, the rest reported by name."""

from contextlib import nullcontext
from math import sqrt
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import fromstring

import pytest

from hil.common.errors import ConfigError
from sim.matrices import square
from sim.sdf.as_urdf import as_urdf
from sim.sdf.files import MAX_FILES, SdfFiles
from sim.sdf.model import models_of
from sim.sensors.sensor_set import read_sensors
from sim.vehicle.urdf.importer import Imported, read_robot
from sim.vehicle.urdf.ros_packages import find_packages

OTTER = Path(__file__).parents[3] / "vectors" / "otter"
MODEL = OTTER / "otter" / "model.sdf"


def imported(path: Path = MODEL, text: str | None = None, model: str | None = None, **extra: Any) -> Imported:
    notes: list[str] = []
    robot = as_urdf(str(path), notes, model, None if text is None else text.encode())
    found = read_robot(robot, str(path), extra)
    return found._replace(notes=notes + found.notes)


def test_the_origin_is_the_link_with_hydrodynamics() -> None:
    """The hull stands 0.1 m ahead of the model's frame; the tail is 0.6 m behind the hull, the propeller 0.05 more."""
    vehicle = imported().vehicle
    assert vehicle.mass == 20.5
    assert "No mass is given for rudder, keel: none is taken, where Gazebo takes 1 kg each." in imported().notes
    assert vehicle.center_of_gravity == pytest.approx((-0.65 * 0.5 / 20.5, 0.0, 0.02 * 20.0 / 20.5))
    (propeller,) = vehicle.thrusters
    assert propeller.position == pytest.approx((-0.65, 0.0, 0.0))
    assert propeller.direction == pytest.approx((1.0, 0.0, 0.0))


def test_the_water_on_all_links_adds_up_at_the_hull() -> None:
    """A second plugin acts 0.1 m behind the hull, the propeller's added mass 0.65 m behind; plugins have any order."""
    more = (
        '<plugin filename="gz-hydrodynamics"><link_name>keel</link_name><yDotV>-3</yDotV><yVabsV>-20</yVabsV></plugin>'
    )
    own = "<inertial><fluid_added_mass><xx>0.01</xx><yy>0.02</yy></fluid_added_mass>"
    text = MODEL.read_text().replace("<inertial><mass>0.5", f"{own}<mass>0.5")
    last, first = (
        imported(text=text.replace(tag, f"{more}{tag}", 1)).vehicle for tag in ("</model>", '<link name="hull">')
    )
    assert last == first
    alone = imported().vehicle
    for key, added in (
        ("added_mass", {(0, 0): 0.01, (1, 1): 3.02, (1, 5): -0.3 - 0.02 * 0.65, (5, 5): 0.03 + 0.02 * 0.65**2}),
        ("quadratic_damping", {(1, 1): 20.0, (5, 1): -2.0, (1, 5): -0.2, (5, 5): 0.02}),
    ):
        both, one = square(getattr(last, key), 6), square(getattr(alone, key), 6)
        assert [both[i][j] - one[i][j] for i, j in added] == pytest.approx(list(added.values()))


def test_what_a_moving_arm_carries_is_named_as_moving() -> None:
    """A gripper that is fixed to an arm moves with it; it stays at its place, 0.8 m ahead of the hull and 0.1 below."""
    text = """<link name="arm"><pose>0.5 0 0 0 0 0</pose></link>
    <joint name="elbow" type="revolute"><parent>hull</parent><child>arm</child><axis><xyz>0 1 0</xyz></axis></joint>
    <link name="gripper"><pose>0.9 0 -0.1 0 0 0</pose>
      <inertial><mass>1</mass><fluid_added_mass><yy>2</yy></fluid_added_mass></inertial></link>
    <joint name="weld" type="fixed"><parent>arm</parent><child>gripper</child></joint></model>"""
    model, alone = imported(text=MODEL.read_text().replace("</model>", text, 1)), imported()
    assert "On joints that move, taken at zero: the water on gripper." in model.notes
    both, one = (square(each.vehicle.added_mass, 6) for each in (model, alone))
    assert [both[i][5] - one[i][5] for i in (1, 5)] == pytest.approx([2.0 * 0.8, 2.0 * 0.8**2])
    assert model.vehicle.mass == alone.vehicle.mass + 1.0


def test_hydrodynamic_derivatives_have_our_signs() -> None:
    """Negative values brake there, positive here; y and r change their direction both, y alone does against x."""
    model = imported()
    added = square(model.vehicle.added_mass, 6)
    assert [added[i][i] for i in range(6)] == [1.5, 18.0, 19.0, 0.0, 2.0, 2.1]
    assert added[1][5] == added[5][1] == -0.4
    assert model.vehicle.linear_damping == (2.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    assert model.vehicle.quadratic_damping == (4.0, 90.0, 0.0, 0.0, 0.0, 8.0)
    assert model.vehicle.forward_speed_damping == (0.0, 0.0, 0.0, 0.0, 0.0, 3.0)
    assert "Left out: the damping yVabsR, by the product of two different speeds." in model.notes
    assert any("xUU" in note for note in model.notes)


def test_a_model_that_faces_its_own_minus_x_is_turned() -> None:
    """Its stern is at +x, as that of MBARI's LRAUV in Gazebo; the vehicle is the same one."""
    text = (
        '<robot name="r"><link name="hull"><inertial><origin xyz="{0} {1} -0.01"/><mass value="20"/>'
        '<inertia ixx="0.1" iyy="2" izz="2" ixy="{2}" ixz="0" iyz="0"/></inertial></link><link name="propeller"/>'
        '<joint name="shaft" type="continuous"><parent link="hull"/><child link="propeller"/>'
        '<origin xyz="{3} 0 0"/><axis xyz="{4} 0 0"/></joint><gazebo>'
        '<plugin filename="gz-sim-thruster-system"><joint_name>shaft</joint_name></plugin>'
        '<plugin filename="gz-sim-hydrodynamics-system">'
        "<link_name>hull</link_name><yDotV>-18</yDotV><yDotR>{5}</yDotR><nDotV>{5}</nDotV><xUabsU>-4</xUabsU>"
        "<disable_coriolis>{6}</disable_coriolis></plugin></gazebo></robot>"
    )
    water = {"volume": 0.02, "dimensions": [1.0, 0.2, 0.2], "center_of_buoyancy": [0.0, 0.0, 0.0]}
    limits = {"every_thruster": {"max_forward": 9.0, "max_reverse": 9.0}}
    vehicles, notes = [], []
    stern, bow = (0.1, 0.02, 0.01, -0.5, 1, 0.3, "true"), (-0.1, -0.02, 0.01, 0.5, -1, -0.3, "false")
    for values in (stern, bow, (*stern[:3], 0.5, *stern[4:])):  # the last one pulls at the bow
        found = read_robot(fromstring(text.format(*values)), "r.urdf", water | limits)
        vehicles.append(found.vehicle)
        notes.append(" ".join(found.notes))
    ahead, astern, _ = vehicles
    assert ["faces its own -x" in each for each in notes] == [False, True, False]
    assert astern.thrusters[0].position == pytest.approx((-0.5, 0.0, 0.0))
    assert astern.thrusters[0].direction == pytest.approx((1.0, 0.0, 0.0))
    for key in ("center_of_gravity", "inertia", "added_mass", "quadratic_damping"):
        assert getattr(astern, key) == pytest.approx(getattr(ahead, key))
    assert [each.munk_share for each in (ahead, astern)] == [(0.0, 0.0, 0.0), (1.0, 1.0, 1.0)]


def test_buoyancy_is_from_collisions_and_size_from_visuals() -> None:
    vehicle = imported().vehicle
    assert vehicle.volume == pytest.approx(3.14159265 * 0.08**2)
    assert vehicle.center_of_buoyancy == pytest.approx((0.0, 0.0, -0.01))
    assert vehicle.dimensions == pytest.approx((1.2, 0.2, 0.2))


def test_a_fin_turns_about_its_joint_axis() -> None:
    """The link is rolled by 90 degrees, so its y is up: ours is down. The keel has no joint that turns it."""
    model = imported()
    (rudder,) = model.vehicle.fins
    assert rudder.name == "rudder"
    assert rudder.position == pytest.approx((-0.61, 0.0, 0.0))
    assert rudder.axis == pytest.approx((0.0, 0.0, -1.0), abs=1e-9)
    assert rudder.chord == pytest.approx((1.0, 0.0, 0.0), abs=1e-9)
    assert (rudder.area, rudder.max_deflection, rudder.polar.lift_slope, rudder.stall_angle) == (0.02, 0.3, 4.0, 0.2)
    assert rudder.polar.induced_drag == pytest.approx(1.25 * 0.2 / (16.0 * 0.2))
    assert any("fin 'keel' (no joint turns it)" in note for note in model.notes)


@pytest.mark.parametrize(
    ("old", "new", "lacks"),
    [("<forward>1 0 0", "<forward>0 2 0", "its joint turns it about its chord"),
     *[(f"<{tag}>", f"<{tag}>0</{tag}><{tag}>", "its lift is not") for tag in ("area", "cla", "alpha_stall")],
     ("<lower>-0.3</lower><upper>0.3", "<lower>-3</lower><upper>3", "")],  # rad: no limit of a fin
)  # fmt: skip
def test_a_fin_that_cannot_steer_is_left_out(old: str, new: str, lacks: str) -> None:
    model = imported(text=MODEL.read_text().replace(old, new, 1))
    assert [fin.max_deflection for fin in model.vehicle.fins] == ([] if lacks else [0.5236])
    assert any(f"fin 'rudder' ({lacks}" in note for note in model.notes) == bool(lacks)


@pytest.mark.parametrize("version", ["1.5", "1.10", "1.12"])
def test_an_axis_is_in_the_joint_frame_since_version_1_5(version: str) -> None:
    text = MODEL.read_text().replace('version="1.7"', f'xmlns:gz="any" version="{version}"')
    assert f'version="{version}"' in text
    assert imported(text=text).vehicle.fins == imported().vehicle.fins
    older = text.replace(f'version="{version}"', 'version="1.4"')
    assert imported(text=older).vehicle.fins != imported().vehicle.fins


def test_sensors_become_scenario_sections() -> None:
    model = imported()
    assert set(model.sensors) == {"imu", "laser", "dvl"}
    imu, laser, dvl = (model.sensors[name] for name in ("imu", "laser", "dvl"))
    assert imu["rate"] == 50.0
    assert imu["angular_velocity"] == {"noise": 0.001, "bias": pytest.approx(0.0001 * sqrt(100.0)), "bias_time": 200.0}
    assert laser["position"] == [0.5, -0.1, -0.05]
    assert (laser["beams"], laser["angle_min"], laser["angle_max"]) == (91, -1.0, 0.5)  # to starboard
    assert (laser["min_range"], laser["max_range"]) == (0.2, 25.0)
    assert dvl["tilt"] == pytest.approx(0.43633, abs=1e-5)
    assert (dvl["min_range"], dvl["max_range"], dvl["velocity"]) == (0.7, 90.0, {"noise": 0.015})
    assert "Left out: the sensor 'nose' (thermal), of a kind that there is not." in model.notes


def test_further_sensors_of_a_kind_have_their_own_names() -> None:
    """Two further lasers go by their names, or by number where a name is that of another kind."""
    text = MODEL.read_text()
    start = text.index('<sensor name="scan"')
    laser = text[start : text.index("</sensor>", start) + len("</sensor>")]
    more = [laser.replace('"scan"', f'"{name}"') for name in ("stern scan", "dvl")]
    model = imported(text=text.replace(laser, laser + "".join(more)))
    assert set(model.sensors) == {"imu", "laser", "dvl", "stern_scan", "laser_2"}
    assert model.sensors["stern_scan"] == {"sensor": "laser", **model.sensors["laser"]}
    assert any("is [sensors.stern_scan], one more laser." in note for note in model.notes)
    assert read_sensors(model.sensors, "flight.toml")["laser_2"].sensor.topic == "laser"


def test_the_vehicle_of_a_world_may_be_included() -> None:
    """The only model with thrusters is the vehicle; what cannot be found is reported."""
    model = imported(OTTER / "bay.sdf")
    assert model.vehicle.name == "swimmer"
    assert model.vehicle.added_mass == imported().vehicle.added_mass
    assert any("models/Moon" in note and "GZ_SIM_RESOURCE_PATH" in note for note in model.notes)
    with pytest.raises(ConfigError, match="does not say mass"):
        imported(OTTER / "bay.sdf", model="drifter")
    with pytest.raises(ConfigError, match=r"give --model NAME, one of: ground, sea, .*swimmer"):
        imported(OTTER / "bay.sdf", model="nobody")


def model_of(name: str, inside: str = "", link: str = '<link name="l"/>') -> str:
    return f'<model name="{name}">{inside}{link}</model>'


@pytest.mark.parametrize(
    ("inside", "chosen"),
    [
        (model_of("quay", "<static>1</static>"), "quay"),
        (model_of("quay", "<static>1</static>") + model_of("auv"), "auv"),
        (model_of("buoy", '<plugin filename="pose"/>') + model_of("auv", '<plugin filename="Thruster"/>'), "auv"),
        (f"<world>{model_of('a')}{model_of('b')}<state><deletions><name>a</name></deletions></state></world>", "b"),
        (model_of("auv", link=""), "the model 'auv' has no links"),
        (model_of("a", "<link name='m'><pose relative_to='g'/></link>"), "relative to 'g', which is not there"),
        (model_of("a", "<link name='m'><visual><pose relative_to='g'>0 0 0</pose></visual></link>"), "'g', which is"),
        (model_of("m", "<joint name='j'><parent>l</parent><child>no</child><axis/></joint>"
                  "<joint type='fixed'><parent>l</parent><child>l</child></joint>"), "m"),
        ("<model name='m'>" * 9 + '<link name="l"/>' + "</model>" * 9, "m"),
        ("<model name='m'>" * 10 + "</model>" * 10, "models in each other, more than 8 deep"),
    ],
)  # fmt: skip
def test_the_vehicle_is_the_only_model_that_moves(inside: str, chosen: str) -> None:
    with pytest.raises(ConfigError, match=chosen) if " " in chosen else nullcontext():
        assert as_urdf("m.sdf", [], None, f"<sdf>{inside}</sdf>".encode()).get("name") == chosen


def test_a_joint_that_holds_the_hull_is_taken_as_fixed() -> None:
    """Without water the hull is the canonical link. A joint without a direction turns about z."""
    shapes = "".join(f"<collision><geometry><{kind}/></geometry></collision>" for kind in ("empty", "plane"))
    joint = '<joint name="j" type="revolute"><parent>a</parent><child>b</child><axis/></joint>'
    model = f'<model canonical_link="b"><link name="a">{shapes}</link><link name="b"/>{joint}</model>'
    notes: list[str] = []
    robot = as_urdf("m.sdf", notes, None, f"<sdf>{model}</sdf>".encode())
    assert [joint.get("name") for joint in robot.findall("joint")] == ["a_joint"]
    fixed = "The joint 'j' holds the link 'b', on which the water acts: taken as fixed."
    assert notes[1:] == ["Left out: the shape <plane> of the link 'a'.", fixed]


def test_names_of_merged_models_are_global_and_of_nested_ones_scoped() -> None:
    """The plugins of an included model follow, as in PX4's models."""
    quarter = '<pose rotation_format="quat_xyzw">'
    for merge, link in (("true", "hull"), ("false", "otter::hull")):
        text = (
            f'<sdf version="1.9"><model name="m"><include merge="{merge}"><uri>model://otter</uri>'
            f'<pose degrees="1">0 0 1 0 0 90</pose></include><link name="b">{quarter}0 3 0 0 0 2 2</pose>'
            f'<inertial><pose relative_to="{link}" rotation_format="quat_xyzw">1 0 0 0 0 0 1</pose><mass>20.5</mass>'
            "</inertial></link></model></sdf>"
        )
        vehicle = imported(OTTER / "m.sdf", text).vehicle
        assert vehicle.thrusters[0].position == pytest.approx((-0.65, 0.0, 0.0), abs=1e-9)
        assert vehicle.thrusters[0].direction == pytest.approx((1.0, 0.0, 0.0), abs=1e-9)
        assert vehicle.center_of_gravity[0] == pytest.approx(0.5 * (1.0 - 0.65 * 0.5 / 20.5))


@pytest.mark.parametrize("version", ["/tip", "/12", ""])
def test_files_of_a_fuel_model_are_found_in_its_download_folder(
    version: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    mesh = tmp_path / ".gz/fuel/fuel.gazebosim.org/somebody/models/a buoy/12/meshes/buoy.dae"
    for file in (mesh.parents[2] / "3/meshes/buoy.dae", mesh):
        file.parent.mkdir(parents=True)
        file.touch()
    uri = f"https://fuel.gazebosim.org/1.0/Somebody/models/A%20Buoy{version}/files/meshes/buoy.dae"
    assert SdfFiles(str(tmp_path / "world.sdf")).find(uri, str(tmp_path)) == str(mesh)


def test_a_model_is_the_file_of_its_newest_version(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is found by the variable or near the file; an include may move it, and must not include itself."""
    monkeypatch.setenv("GZ_SIM_RESOURCE_PATH", str(tmp_path / "shared"))
    versions = '<sdf>c</sdf><sdf version="1.9">a.sdf</sdf><sdf version="1.10">b.sdf</sdf>'
    again, pose = "<include><uri>model://auv</uri>{}</include>", "<pose>{} 9 9 0 0 0</pose>"
    for name, text in {
        "auv/model.config": versions, "auv/model.sdf": "", "auv/b.sdf": model_of("b", again.format("")),
        "auv/a.sdf": model_of("a", pose.format(9)), "deep/rov/a.stl": "", ".old/rov/a.stl": "",
    }.items():  # fmt: skip
        file = tmp_path / ("shared" if "auv" in name else "a/near") / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text if "config" in name else f"<sdf>{text}</sdf>")
    files, folder = SdfFiles(str(tmp_path / "a/b/c/m.sdf")), str(tmp_path / "a/b/c")  # four folders are searched
    for uri, chosen in (("model://auv", "b"), ("auv/a.sdf", "a"), (f"file://{tmp_path}/shared/auv", "b")):
        root, _ = files.read_model(uri, folder) or pytest.fail(uri)
        assert root[0].get("name") == chosen
    (tmp_path / "a/near/loop").symlink_to(tmp_path)
    assert list(find_packages("rov", files.path)) == [str(tmp_path / "a/near/deep/rov")]
    assert files.find("rov/a.stl", folder) == str(tmp_path / "a/near/deep/rov/a.stl")
    placed = again.replace("model://auv", "auv/a.sdf").format("<static>1</static>" + pose.format(1))
    (model,) = models_of(fromstring(f"<sdf>{placed}</sdf>"), folder, files, [], "1.9")
    assert (model.is_static, model.pose.position) == (True, (1.0, 9.0, 9.0))
    with pytest.raises(ConfigError, match="models in each other"):
        models_of(fromstring(f"<sdf>{again}</sdf>"), folder, files, [], "1.9")
    for _ in range(13, MAX_FILES):
        assert files.read_model("model://sun", folder)
    with pytest.raises(ConfigError, match="includes more than 500 models"):
        files.read_model("model://sun", folder)


def test_files_outside_of_the_models_folders_are_not_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A path that leads out, a link, or a network address is refused; a folder in the variable is allowed."""
    inside, outside = tmp_path / "a/b/c/model", tmp_path / "secret"
    inside.mkdir(parents=True)
    outside.mkdir()
    (outside / "x.stl").touch()
    (inside / "model.sdf").touch()
    (inside / "own.stl").touch()
    (inside / "way").symlink_to(outside)
    files = SdfFiles(str(inside / "model.sdf"))
    for uri in ("../../../../secret/x.stl", f"file://{outside}/x.stl", str(outside / "x.stl"), "way/x.stl",
                "https://example.org/x.stl", "model://model/../../../../secret/x.stl"):  # fmt: skip
        assert files.find(uri, str(inside)) is None, uri
    assert files.find("own.stl", str(inside)) == str(inside / "own.stl")
    assert files.find("model://model/own.stl", str(inside)) == str(inside / "own.stl")
    monkeypatch.setenv("GZ_SIM_RESOURCE_PATH", str(tmp_path))
    found = SdfFiles(str(inside / "model.sdf")).find("model://secret/x.stl", str(inside))
    assert found == str(outside / "x.stl")
