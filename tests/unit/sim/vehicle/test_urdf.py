"""Import of URDF: axes turned, links added up, and nothing guessed."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hil.commands.vehicle.import_urdf import to_toml
from hil.common.errors import ConfigError
from sim.matrices import square
from sim.sdf.files import SdfFiles
from sim.vehicle.thrusters.bank import wrench_matrix
from sim.vehicle.urdf.importer import read_urdf
from sim.vehicle.urdf.text import find_mesh
from sim.vehicle.vehicle import Vehicle, load_vehicle

VECTORS = Path(__file__).parents[3] / "vectors"
KEYS: dict[str, Any] = {
    "volume": 0.024,
    "dimensions": [0.6, 0.4, 0.35],
    "center_of_buoyancy": [0.0, 0.0, -0.05],
    "every_thruster": {"max_forward": "60 N", "max_reverse": 45},
}


def hydra() -> Vehicle:
    vehicle, notes = read_urdf(str(VECTORS / "hydra.urdf"))
    assert notes == []
    return vehicle


def test_masses_of_all_links_add_up() -> None:
    """The sum equals numpy's: two bodies, parallel axes, the second turned by 90 degrees; then half a turn about x."""
    vehicle = hydra()
    ned_from_enu = np.diag([1.0, -1.0, -1.0])
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    base, battery = np.array([0.0, 0.0, -0.02]), np.array([0.1, 0.1, -0.1]) + quarter @ [0.05, 0.0, 0.0]
    centre = (24.0 * base + 6.0 * battery) / 30.0
    inertia = np.array([[0.8, 0.01, -0.02], [0.01, 1.1, 0.03], [-0.02, 0.03, 1.4]])
    inertia = inertia + quarter @ np.diag([0.02, 0.06, 0.07]) @ quarter.T
    for mass, place in ((24.0, base - centre), (6.0, battery - centre)):
        inertia += mass * (place @ place * np.eye(3) - np.outer(place, place))
    assert vehicle.mass == 30.0
    assert vehicle.center_of_gravity == pytest.approx(ned_from_enu @ centre)
    assert np.array(square(vehicle.inertia, 3)) == pytest.approx(ned_from_enu @ inertia @ ned_from_enu)


def test_every_thruster_applies_also_to_given_thrusters() -> None:
    """A URDF without thrusters is completed by a file that has them: their common keys apply to these."""
    row = {"name": "only", "position": [0.0, 0.0, 0.0], "direction": [1, 0, 0], "max_reverse": 30}
    vehicle, _ = read_urdf(str(VECTORS / "hydra.urdf"), {**KEYS, "thrusters": [row]})
    (thruster,) = vehicle.thrusters
    assert (thruster.name, thruster.max_forward, thruster.max_reverse) == ("only", 60.0, 30.0)


def test_thrusters_are_turned_to_frd() -> None:
    """The signs of port and up are negative; a thruster on a tilted bracket adds up along the tree."""
    first, second, third = hydra().thrusters
    assert (first.name, second.name, third.name) == ("thruster_0", "thruster_1", "thruster_2")
    assert first.position == pytest.approx((-0.25, -0.15, 0.0))
    assert first.unit_direction == pytest.approx((0.5**0.5, -(0.5**0.5), 0.0))
    assert third.position == pytest.approx((0.1, -0.2, -0.15))  # the bracket's x axis points up
    assert third.unit_direction == pytest.approx((0.0, 0.0, -1.0))
    assert (first.max_forward, first.max_reverse, first.time_constant) == (60.0, 45.0, 0.1)


def test_the_model_in_turned_axes_has_the_same_physics() -> None:
    """Wrenches and momenta of the FLU model, computed in FLU and turned as vectors, are those of the FRD one."""
    vehicle = hydra()
    six = np.diag([1.0, -1.0, -1.0, 1.0, -1.0, -1.0])
    added = np.diag([12.0, 20.0, 32.0, 0.5, 0.7, 0.6])
    added[0, 4] = added[4, 0] = 0.4
    added[1, 3] = added[3, 1] = -0.6
    nu = np.array([0.3, -0.7, 0.2, 0.5, -0.4, 0.9])
    assert np.array(square(vehicle.added_mass, 6)) @ (six @ nu) == pytest.approx(six @ (added @ nu))
    force = np.array([0.5**0.5, 0.5**0.5, 0.0])  # thruster_0, FLU
    flu = np.concatenate([force, np.cross([-0.25, 0.15, 0.0], force)])
    assert np.array(wrench_matrix(vehicle))[:, 0] == pytest.approx(six @ flu)
    assert vehicle.linear_damping == (8.0, 9.0, 12.0, 1.0, 1.2, 1.5)
    assert vehicle.quadratic_damping == (60.0, 90.0, 130.0, 2.0, 2.5, 3.0)
    assert vehicle.center_of_buoyancy == (0.0, -0.01, -0.05)
    assert (vehicle.volume, vehicle.dimensions) == (0.0301, (0.6, 0.4, 0.35))


def test_thrust_that_a_model_lacks_reaches_a_usual_speed() -> None:
    """Its simulator has no limit then."""
    text = re.sub(r"<thrust_m..>.*?</thrust_m..>", "", (VECTORS / "hydra.urdf").read_text())
    vehicle, notes = read_urdf("hydra.urdf", {}, text.encode())
    (limit,) = {thruster.max_forward for thruster in vehicle.thrusters}
    assert {thruster.max_reverse for thruster in vehicle.thrusters} == {limit}
    ahead = sum(abs(thruster.unit_direction[0]) for thruster in vehicle.thrusters) * limit
    drag = 1.5 * vehicle.linear_damping[0] + 1.5**2 * vehicle.quadratic_damping[0]
    assert ahead == pytest.approx(drag, rel=0.01)
    assert any(f"max_forward of 3 thrusters: {limit:g} N, for 1.5 m/s ahead" in note for note in notes)


def without_inertia() -> bytes:
    text = (VECTORS / "hydra.urdf").read_text()
    return re.sub(r"<inertial>.*?</inertial>", "", text, flags=re.DOTALL).encode()


def test_a_urdf_without_inertia_uses_the_given_one() -> None:
    """Mass and inertia are requested by name, and those given are used."""
    path, inertial = str(VECTORS / "hydra.urdf"), {"mass": "31 kg", "inertia": [0.8, 1.1, 1.4]}
    for missing, rest in ((["mass", "inertia"], {}), (["inertia"], {"mass": 31.0}), (["mass"], {"inertia": [1.0] * 3})):
        with pytest.raises(ConfigError, match=f"does not say {', '.join(missing)}: write"):
            read_urdf(path, rest, without_inertia())
    vehicle, notes = read_urdf(path, inertial, without_inertia())
    assert (vehicle.mass, vehicle.inertia, notes) == (31.0, (0.8, 1.1, 1.4), [])
    massive = (VECTORS / "hydra.urdf").read_text().replace("<inertia ", "<no_inertia ").encode()
    with pytest.raises(ConfigError, match="does not say inertia: write"):
        read_urdf(path, {}, massive)
    assert read_urdf(path, {"inertia": [1.0] * 3}, massive)[0].mass == 30.0


def test_a_given_mass_is_used_everywhere() -> None:
    """The mass sets the volume of a neutrally buoyant vehicle; a warning states that the inertia stays."""
    text = (VECTORS / "hydra.urdf").read_text().replace("<volume>0.0301</volume>", "")
    neutral = text.replace("<neutrally_buoyant>0<", "<neutrally_buoyant>1<").encode()
    vehicle, notes = read_urdf("hydra.urdf", {"mass": "40 kg"}, neutral)
    assert (vehicle.mass, vehicle.volume, vehicle.neutrally_buoyant) == (40.0, 0.04, True)
    assert notes == ["The mass is the one given, the inertia still that of the URDF."]


def test_the_written_file_loads_as_the_same_vehicle(tmp_path: Path) -> None:
    vehicle = hydra()
    path = tmp_path / "hydra.toml"
    path.write_text(to_toml(vehicle, ["a note"]))
    again, _ = load_vehicle(str(path))
    for key, value in vehicle._asdict().items():
        if key != "thrusters":
            assert getattr(again, key) == (pytest.approx(value, abs=1e-12) if isinstance(value, tuple) else value), key
    assert len(again.thrusters) == 3
    assert again.thrusters[2].direction == (0.0, 0.0, -1.0)  # without the dust of sines and cosines


def test_a_plain_urdf_needs_only_names(tmp_path: Path) -> None:
    """Revolute joints of links named thruster are enough, without plugin or tag; SDFormat's added mass is read."""
    path = tmp_path / "plain.urdf"
    path.write_text(
        '<robot name="p\'s &quot;rov&quot;"><link name="base"><inertial><mass value="9"/>'
        '<inertia ixx="1" iyy="1" izz="1"/>'
        "<fluid_added_mass><xx>2</xx><yy>3</yy><zz>4</zz><pp>.1</pp><qq>.1</qq><rr>.1</rr><yr>.2</yr></fluid_added_mass>"
        '</inertial></link><link name="thruster_a"/><joint name="j" type="continuous"><parent link="base"/>'
        '<child link="thruster_a"/><limit/></joint><link name="thruster_arm"/><joint name="k" type="revolute">'
        '<parent link="base"/><child link="thruster_arm"/><limit/></joint></robot>'
    )
    extra = KEYS | {"linear_damping": [1.0] * 6, "quadratic_damping": [2.0] * 6}
    vehicle, notes = read_urdf(str(path), extra)
    assert notes == ["No thruster plugin: every turning joint of a link named thruster is one."]
    (thruster,) = vehicle.thrusters  # the arm has a limit
    assert thruster.direction == (1.0, 0.0, 0.0)  # the axis of a URDF joint that gives none
    added = square(vehicle.added_mass, 6)
    assert added[1][5] == added[5][1] == 0.2
    (tmp_path / "p.toml").write_text(to_toml(vehicle, notes))
    assert load_vehicle(str(tmp_path / "p.toml"))[0].name == 'p\'s "rov"'


FIN = """<link name="hydra/fin0"/><joint name="f" type="revolute">
<origin xyz="-0.4 0.1 0.05" rpy="1.5707963267948966 0 0"/>
<parent link="hydra/base_link"/><child link="hydra/fin0"/></joint>
<gazebo><plugin name="a" filename="libuuv_fin_ros_plugin.so"><link_name>hydra/fin0</link_name><joint_name>f</joint_name>
<liftdrag><type>TwoLines</type><area>0.02</area></liftdrag></plugin></gazebo>
<gazebo><plugin name="b" filename="gz-sim-lift-drag-system">
<link_name>wing</link_name><area>0.3</area></plugin></gazebo>
<gazebo><plugin name="c" filename="libLiftDragPlugin.so"><link_name>hydra/fin0</link_name></plugin></gazebo>
</robot>"""


def test_fins_are_reported_and_given_ones_retained(tmp_path: Path) -> None:
    """Each fin is reported once by its name, with the table to write; the file contains the given ones."""
    text = (VECTORS / "hydra.urdf").read_text().replace("</robot>", FIN).encode()
    path = str(VECTORS / "hydra.urdf")
    vehicle, notes = read_urdf(path, {}, text)
    assert vehicle.fins == ()
    assert notes == [
        "Left out: the fin 'fin0' (its lift is not one of uuv_simulator's or Gazebo's), "
        "position [-0.4, -0.1, -0.05], axis [0, 1, 0], chord [1, 0, 0], area 0.02 m². "
        "Write it under [[fins]] with this name and --add it.",
        "Left out: the fin 'wing' (no such link), area 0.3 m². Write it under [[fins]] with this name and --add it.",
    ]
    fin = {"name": "fin0", "position": [-0.4, -0.1, -0.05], "axis": [0, 1, 0], "area": 0.02, "aspect_ratio": 2.0}
    given = {"fins": [fin | {"max_deflection": 0.35}], "forward_speed_damping": [1.0] * 6}
    vehicle, notes = read_urdf(path, given, text)
    assert [note[:24] for note in notes] == ["Left out: the fin 'wing'"]
    (tmp_path / "h.toml").write_text(to_toml(vehicle, notes))
    again, _ = load_vehicle(str(tmp_path / "h.toml"))
    assert again.fins == vehicle.fins
    assert again.forward_speed_damping == (1.0,) * 6
    assert again.channels[-1] == "fin0"


@pytest.mark.parametrize("given", [{"fins": 3}, {"thrusters": [1]}, {"every_thruster": 3}])
def test_given_keys_that_are_no_tables_are_reported(given: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match=f"{next(iter(given))}: expected a table"):
        read_urdf(str(VECTORS / "hydra.urdf"), given)


JOINT = '<joint name="j"><origin xyz="1 2"/><parent link="b"/><child link="c"/>'
BASE = '<link name="b"><inertial><mass value="1"/></inertial></link>'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<robot", "not valid XML"),
        ("<sdf version='1.9'/>", "begins with <robot>, this one with <sdf>"),
        ('<!DOCTYPE r [<!ENTITY a "ha">]><robot name="&a;"/>', "declares the XML entity 'a'"),
        ('<!DOCTYPE r [<!ENTITY a SYSTEM "file:///etc/hostname">]><robot name="x">&a;</robot>', "the XML entity 'a'"),
        ('<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:property name="m"/></robot>', "is xacro"),
        ('<robot><link name="b"><inertial><mass value="${m}"/></inertial></link></robot>', "is xacro"),
        ("<robot/>", "0 of them hang on no other"),
        (f'<robot>{BASE}<link name="c"/></robot>', "2 of them hang on no other"),
        (f'<robot>{BASE}<link name="c"/><joint><parent link="c"/><child link="c"/></joint></robot>', "join them"),
        ('<robot><link name="b"/></robot>', "does not say mass, inertia, volume"),
        (
            '<robot><link name="b"><inertial><mass value="nan"/></inertial></link></robot>',
            "link 'b': <inertial>: <mass value>: expected a number, found 'nan'",
        ),
        (f'<robot>{BASE}<plugin filename="thruster"><jointName>x</jointName></plugin></robot>', "the joint 'x'"),
        (f'<robot>{BASE}<link name="c"/>{JOINT}</joint></robot>', "expected 3 numbers, found '1 2'"),
        (
            f'<robot>{BASE}{JOINT}</joint><plugin filename="thruster"><jointName>j</jointName></plugin></robot>',
            "the link 'c' of a thruster is not there",
        ),
        (f"<robot>{BASE}{63 * '<a>'}{63 * '</a>'}</robot>", "[[thrusters]]"),
        (f"<robot>{64 * '<a>'}", "elements in each other, more than 64 deep, at <a>"),
    ],
)
def test_wrong_files_are_reported(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "m.urdf"
    path.write_text(text)
    with pytest.raises(ConfigError, match=r"m\.urdf") as caught:
        read_urdf(str(path))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("variable", "value", "place"),
    [
        ("", "", "src/b_description"),  # beside the package of the file
        ("", "", "src/a/a_description"),  # no such package: the same path in the folders above the file
        ("AMENT_PREFIX_PATH", "far", "far/share/b_description"),
        ("ROS_PACKAGE_PATH", "far", "far/deep/er/b_description"),
        ("GZ_SIM_RESOURCE_PATH", "far", "far/b_description"),
        ("IGN_GAZEBO_RESOURCE_PATH", "far/b_description/models", "far/b_description"),
    ],
)
@pytest.mark.parametrize("scheme", ["package", "model"])
def test_a_mesh_of_another_package_is_found(
    variable: str, value: str, place: str, scheme: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot, mesh = tmp_path / "src/a/a_description/urdf/robots/v1/x.urdf", tmp_path / place / "meshes/my hull.stl"
    for file in (robot, mesh, tmp_path / "src/a/a_description/package.xml"):
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text("<package><name>a_description</name></package>")
    if variable:
        monkeypatch.setenv(variable, str(tmp_path / value))
    uri = f"{scheme}://b_description/meshes/my%20hull.stl"
    assert find_mesh(uri, str(robot)) == str(mesh)
    if variable or place == "src/b_description":
        assert SdfFiles(str(robot)).find(uri, str(robot.parent)) == str(mesh)
