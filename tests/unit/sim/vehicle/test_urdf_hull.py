"""Models whose root is not the hull, and models with several links in the water: the same physics in either case."""

from math import pi
from xml.etree import ElementTree

import numpy as np
import pytest
from numpy.typing import NDArray

from hil.common.errors import ConfigError
from sim.matrices import square
from sim.vehicle.urdf.hull import Tree, moved
from sim.vehicle.urdf.importer import Imported, read_robot
from sim.vehicle.urdf.pose import pose_at
from sim.vehicle.urdf.shapes import Solid, _primitive
from sim.vehicle.urdf.text import read_xml
from sim.vehicle.vehicle import Vehicle

HULL = """<link name="base_link"><collision><origin xyz="0 0 0.02"/><geometry><box size="0.8 0.5 0.05"/></geometry>
</collision><inertial><mass value="20"/><inertia ixx="0.4" iyy="0.8" izz="0.9"/></inertial></link>
<gazebo reference="base_link"><sensor name="imu" type="imu"><pose>0.1 0.2 0.3 0 0 0</pose></sensor></gazebo>"""
THRUSTER = """<link name="thruster"/><joint name="tj" type="continuous"><origin xyz="-0.3 0.2 0"/>
<parent link="base_link"/><child link="thruster"/></joint><gazebo><plugin filename="libuuv_thruster_ros_plugin.so">
<jointName>tj</jointName><conversion><type>Basic</type><rotorConstant>0.0004</rotorConstant></conversion>
<clampMin>-300</clampMin><clampMax>300</clampMax></plugin></gazebo>"""
UUV = """<gazebo><plugin filename="libuuv_underwater_object_ros_plugin.so"><link name="base_link">
<volume>0.0195</volume><center_of_buoyancy>0 0 0.05</center_of_buoyancy>
<box><length>0.8</length><width>0.5</width><height>0.3</height></box>
<hydrodynamic_model><type>fossen</type><added_mass>10 15 20 0.3 0.5 0.6</added_mass>
<linear_damping>-10 -11 -12 -2 -3 -4</linear_damping><quadratic_damping>-40 -60 -80 -2 -3 -4</quadratic_damping>
</hydrodynamic_model></link></plugin></gazebo>"""
GAZEBO = """<gazebo><plugin filename="gz-sim-hydrodynamics-system"><link_name>base_link</link_name><xDotU>-10</xDotU>
<yDotV>-15</yDotV><xU>-10</xU><nR>-4</nR><xUabsU>-40</xUabsU></plugin></gazebo>"""
ARM = """<link name="arm"><inertial><mass value="2"/><inertia ixx="0.01" iyy="0.01" izz="0.01"/></inertial></link>
<joint name="aj" type="revolute"><origin xyz="0.5 0 -0.1"/><parent link="base_link"/><child link="arm"/></joint>"""
ARM_WATER = """<gazebo><plugin filename="libuuv_underwater_object_ros_plugin.so"><link name="arm">
<volume>0.0015</volume><box><length>9</length><width>9</width><height>9</height></box>
<hydrodynamic_model><type>fossen</type><added_mass>1 2 2 0 0 0</added_mass>
<quadratic_damping>-5 -9 -9 0 0 0</quadratic_damping></hydrodynamic_model></link></plugin></gazebo>"""
MATRICES = {"inertia": 3, "added_mass": 6, "linear_damping": 6, "quadratic_damping": 6}


def imported(*parts: str) -> Imported:
    return read_robot(read_xml("box.urdf", f"<robot name='box'>{''.join(parts)}</robot>".encode()), "box.urdf")


def on(root: str, origin: str) -> str:
    ends = f'<parent link="{root}"/><child link="base_link"/>'
    return f'<link name="{root}"/><joint type="fixed"><origin {origin}/>{ends}</joint>'


def matrix(vehicle: Vehicle, key: str) -> NDArray[np.float64]:
    return np.array(square(getattr(vehicle, key), MATRICES[key]))


@pytest.mark.parametrize(
    ("parts", "missing"),
    [
        ((HULL, THRUSTER, UUV.replace("volume>", "none>")), "volume"),  # that of collisions is only Gazebo's
        ((HULL.replace("collision>", "none>"), THRUSTER.replace("clamp", "no"), GAZEBO),
         r"volume, dimensions, center_of_buoyancy, \[every_thruster\] max_forward, \[every_thruster\] max_reverse"),
        ((HULL, ARM, THRUSTER, ARM_WATER.replace("box>", "none>").replace("fossen", "cylinder")), "<radius>"),
        ((HULL, THRUSTER, '<plugin filename="hydrodynamics"/>'), "added_mass, linear_damping, quadratic_damping"),
    ],
)  # fmt: skip
def test_what_no_tag_gives_is_missing(parts: tuple[str, ...], missing: str) -> None:
    with pytest.raises(ConfigError, match=f"does not say {missing}: write"):
        imported(*parts)


@pytest.mark.parametrize("water", [UUV, GAZEBO])
def test_an_empty_root_below_the_hull_changes_nothing(water: str) -> None:
    """Vehicle and sensors are those of the hull alone, and a note says where the origin is."""
    plain = imported(HULL, THRUSTER, water)
    raised = imported(on("base_footprint", 'xyz="0 0 0.5" rpy="0 0 0"'), HULL, THRUSTER, water)
    assert raised.vehicle == plain.vehicle
    assert raised.sensors == plain.sensors
    assert not any("origin" in note for note in plain.notes)
    assert "The origin is that of 'base_link', the hull, at [0, 0, 0.5] m in 'base_footprint'" in raised.notes[0]


def test_a_turned_hull_turns_everything() -> None:
    """The hull is turned to port by 90 degrees in the root: to starboard is negative in our axes."""
    plain = imported(HULL, THRUSTER, UUV)
    turned = imported(on("world", 'xyz="0 0 -2" rpy="0 0 1.5707963"'), HULL, THRUSTER, UUV)
    turn = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    six = np.kron(np.eye(2), turn)
    for key, size in MATRICES.items():
        by = turn if size == 3 else six
        assert matrix(turned.vehicle, key) == pytest.approx(by @ matrix(plain.vehicle, key) @ by.T, abs=1e-6), key
    assert turned.vehicle.dimensions == pytest.approx((0.5, 0.8, 0.3))
    assert turned.vehicle.center_of_buoyancy == pytest.approx((0.0, 0.0, -0.05))
    one, other = plain.vehicle.thrusters[0], turned.vehicle.thrusters[0]
    assert other.position == pytest.approx(turn @ one.position)
    assert other.direction == pytest.approx(turn @ one.direction, abs=1e-6)
    assert turned.sensors["imu"]["position"] == pytest.approx(turn @ plain.sensors["imu"]["position"])
    assert "turned by roll, pitch, yaw [0, 0, 90] deg" in turned.notes[0]


def test_a_matrix_about_another_origin_has_the_same_energy_and_force() -> None:
    """Energy and power of every motion are those in the link's frame; forces of squares those of one axis alone."""
    pose = pose_at((0.3, -0.2, 0.5), (0.4, -0.7, 2.0))
    random = np.random.default_rng(1)
    inner = random.normal(size=(6, 6))
    rotation, place = np.array(pose.rotation), np.array(pose.position)
    outer = np.array(moved(inner.tolist(), pose))
    squares = np.array(moved(inner.tolist(), pose, of_squares=True))

    def in_link(nu: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.concatenate([rotation.T @ (nu[:3] + np.cross(nu[3:], place)), rotation.T @ nu[3:]])

    for nu in random.normal(size=(5, 6)):
        assert nu @ outer @ nu == pytest.approx(in_link(nu) @ inner @ in_link(nu))
    for axis in np.eye(6):
        force = inner @ (in_link(axis) * abs(in_link(axis)))
        push, moment = rotation @ force[:3], rotation @ force[3:]
        assert squares @ axis == pytest.approx(np.concatenate([push, moment + np.cross(place, push)]))


def test_links_in_the_water_add_up_in_any_order() -> None:
    first = imported(HULL, ARM, THRUSTER, UUV, ARM_WATER)
    vehicle = first.vehicle
    assert vehicle == imported(ARM, ARM_WATER, THRUSTER, UUV, HULL).vehicle
    assert (vehicle.mass, vehicle.dimensions) == (22.0, (0.8, 0.5, 0.3))
    assert vehicle.volume == pytest.approx(0.021)
    assert vehicle.center_of_buoyancy == pytest.approx(
        (0.5 * 0.0015 / 0.021, 0.0, (0.1 * 0.0015 - 0.05 * 0.0195) / 0.021)
    )
    assert np.diag(matrix(vehicle, "added_mass"))[:3] == pytest.approx([11.0, 17.0, 22.0])
    assert matrix(vehicle, "added_mass")[5, 5] == pytest.approx(0.6 + 2.0 * 0.5**2)
    assert matrix(vehicle, "quadratic_damping")[1, 1] == pytest.approx(69.0)
    assert "On joints that move, taken at zero: the water on arm." in first.notes
    fixed = imported(HULL, ARM.replace("revolute", "fixed"), THRUSTER, UUV, ARM_WATER)
    assert fixed.vehicle == vehicle
    assert not any("joints" in note for note in fixed.notes)
    off = GAZEBO.replace("xUabsU", "other").replace("<xU>", "<disable_added_mass>true</disable_added_mass><xU>")
    undamped = imported(HULL, THRUSTER, off)
    assert undamped.vehicle.quadratic_damping == undamped.vehicle.added_mass == (0.0,) * 6
    assert "The model does not say added_mass, quadratic_damping: 0, as its simulator has it." in undamped.notes
    assert "The volume, 0.02 m³, is that of the collisions, as Gazebo's buoyancy has it." in undamped.notes


def test_the_hull_is_a_link_of_the_heaviest_body() -> None:
    """A propeller that turns is never the hull; in the heaviest body it is the link in the water."""
    masses = {"root": 0.0, "shell": 20.0, "battery": 30.0, "propeller": 2.0}
    parents = {"shell": ("root", True), "battery": ("shell", True), "propeller": ("root", False)}
    for wet, hull in (("shell", "shell"), ("battery", "battery"), ("propeller", "battery")):
        assert Tree(masses, frozenset({wet, "propeller"}), parents).hull("root") == hull
    assert Tree(masses | {"root": 1.0}, frozenset(), parents).hull("root") == "root"


def test_an_inertia_of_no_body_is_lowered() -> None:
    """As in the public ECA A9, of 0.6, 30 and 35 kg m²: the greatest is that of no body."""
    hull = HULL.replace('izz="0.9"', 'izz="1.5"')
    model = imported(hull, THRUSTER, UUV)
    assert model.vehicle.inertia == pytest.approx((0.4, 0.8, 0.999 * 1.2))
    assert any("The greatest moment of inertia is 1.1988 kg m²: that of the model, 1.5," in n for n in model.notes)
    turned = imported(on("root", 'rpy="0.3 -0.2 1"'), hull, THRUSTER, UUV).vehicle
    assert np.linalg.eigvalsh(matrix(turned, "inertia")) == pytest.approx([0.4, 0.8, 0.999 * 1.2])


def test_neutral_buoyancy_is_that_of_the_link() -> None:
    neutral = "<neutrally_buoyant>1</neutrally_buoyant>"
    arm = ARM_WATER.replace("<volume>0.0015</volume>", neutral)
    model = imported(HULL, ARM, THRUSTER, UUV, arm)
    assert not model.vehicle.neutrally_buoyant
    assert model.vehicle.volume == pytest.approx(0.0195 + 2.0 / 1025.0)
    assert "Neutrally buoyant by themselves, in sea water: arm." in model.notes
    hull = UUV.replace("<volume>0.0195</volume>", neutral)
    assert imported(HULL, ARM, THRUSTER, hull, arm).vehicle.neutrally_buoyant
    assert imported(HULL, ARM.replace("revolute", "fixed"), THRUSTER, hull).vehicle.neutrally_buoyant
    loose = imported(HULL, ARM, THRUSTER, hull).vehicle  # the arm has a mass, but no water
    assert not loose.neutrally_buoyant
    assert loose.volume == pytest.approx(20.0 / 1025.0)


@pytest.mark.parametrize(
    ("shape", "sizes"),
    [('<cylinder radius="0.03" length="0.5"/>', (0.03, 0.5, 2)), ('<box size="0.4 0.1 0.1"/>', (0.05, 0.4, 0))],
)
def test_a_cylinder_without_sizes_fills_the_box_around_it(shape: str, sizes: tuple[float, float, int]) -> None:
    radius, length, along = sizes
    arm = ARM.replace("<inertial>", f"<collision><geometry>{shape}</geometry></collision><inertial>")
    water = "<volume>0.0015</volume><hydrodynamic_model><type>cylinder</type></hydrodynamic_model>"
    water = f'<gazebo><plugin><link name="arm">{water}</link></plugin></gazebo>'
    model = imported(HULL, arm, THRUSTER, UUV, water)
    disc = 1028.0 * np.pi * radius**2
    expected = [disc if axis == along else disc * length for axis in range(3)]
    added = np.diag(matrix(model.vehicle, "added_mass"))[:3] - [10.0, 15.0, 20.0]
    assert added == pytest.approx(expected, rel=1e-6)
    assert f"The cylinder of arm fills the box around it: radius {radius:g} m, length {length:g} m" in " ".join(
        model.notes
    )


def test_a_mesh_of_the_collisions_is_measured() -> None:
    mesh = HULL.replace('<box size="0.8 0.5 0.05"/>', '<mesh filename="h.stl" scale="1 2 3"/>')
    solid = Solid(0.02, (0.1, 0.0, 0.0), (-0.5, -0.2, -0.1), (0.5, 0.2, 0.3), is_closed=False)
    robot = read_xml("box.urdf", f"<robot name='box'>{mesh}{THRUSTER}{GAZEBO}</robot>".encode())
    model = read_robot(robot, "box.urdf", {}, lambda keys: {key: solid for key in keys if key[1] == (1.0, 2.0, 3.0)})
    assert (model.vehicle.volume, model.vehicle.center_of_buoyancy) == (0.02, (0.1, 0.0, -0.02))
    assert model.vehicle.dimensions == pytest.approx((1.0, 0.4, 0.4))
    assert "A mesh of the collisions is not closed: the volume may be wrong." in model.notes


@pytest.mark.parametrize(
    ("text", "volume", "half"),
    [
        ('<box size="1 2 3"/>', 6.0, (0.5, 1.0, 1.5)),
        ('<sphere radius="0.5"/>', pi / 6.0, (0.5, 0.5, 0.5)),
        ('<cylinder radius="0.5" length="3"/>', 0.75 * pi, (0.5, 0.5, 1.5)),
        ('<capsule radius="0.5" length="3"/>', 0.75 * pi + pi / 6.0, (0.5, 0.5, 2.0)),
        ('<ellipsoid radii="1 2 3"/>', 8.0 * pi, (1.0, 2.0, 3.0)),
    ],
)
def test_shapes_have_their_volume_and_size(text: str, volume: float, half: tuple[float, float, float]) -> None:
    solid = _primitive(ElementTree.fromstring(text), "a.urdf")
    assert solid is not None
    assert solid[0] == pytest.approx(volume)
    assert tuple(solid[3]) == half
