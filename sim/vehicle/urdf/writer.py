"""Write a vehicle as a URDF: links, joints, shapes and inertia, and the tags of simulators that the importer reads.

The hull is one link, `base_link`, at the body's origin. Each thruster and fin is a link `NAME_link` on a joint NAME
that turns about its axis. URDF's axes are FLU, ours FRD; see `sim.vehicle.urdf.importer`. Not written, because URDF and
the tags of simulators cannot describe them: curves, lift of the hull, ballast, battery. A fin's coefficients are in a
plugin of Gazebo; keys for which it has no tags are in its tag `uuv_hil`, which the importer reads and Gazebo ignores.
"""

from collections.abc import Sequence
from math import acos, asin, atan2, hypot
from xml.etree import ElementTree

from sim.matrices import square, transpose
from sim.vehicle.fins import Fin
from sim.vehicle.meshes import Mesh
from sim.vehicle.thrusters.model import Thruster
from sim.vehicle.urdf.fins import OWN
from sim.vehicle.urdf.pose import Pose, pose_at
from sim.vehicle.urdf.text import Element, to_frd, to_frd_matrix
from sim.vehicle.vehicle import Vehicle

to_flu, to_flu_matrix = to_frd, to_frd_matrix  # half a turn about x is its own inverse
PROPELLER = 0.03, 0.05  # m: the length, and the radius if the file gives no diameter
DENSITY = 1000.0  # kg/m³
_TAGGED = ("area", "max_deflection")  # keys of a fin that a tag of the plugin or the joint contains
MIN_AREA = 1e-6  # m²
FIN_THICKNESS = 0.01  # m
EFFORT, RATE = 10.0, 10.0  # of a fin's servo (N m, rad/s): a joint with limits must have them
HULL, THRUSTER, FIN = "0.98 0.80 0.08 1", "0.12 0.16 0.23 1", "0.40 0.45 0.55 1"  # red, green, blue, opacity


def urdf_of(vehicle: Vehicle, prefix: str = "") -> str:
    """Return the URDF of a vehicle; `prefix` is put before the names of its links, as before those of its frames."""
    robot = Element("robot", name=vehicle.name)
    base = f"{prefix}base_link"
    robot.append(_hull(vehicle, base))
    for thruster in vehicle.thrusters:
        _add_thruster(robot, thruster, base, prefix)
    for fin in vehicle.fins:
        _add_fin(robot, fin, base, prefix)
    _add_water(robot, vehicle, base)
    ElementTree.indent(robot)
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(robot, encoding="unicode") + "\n"


def _hull(vehicle: Vehicle, name: str) -> Element:
    link = Element("link", name=name)
    inertial = _inside(link, "inertial")
    _inside(inertial, "origin", xyz=_words(to_flu(vehicle.center_of_gravity)), rpy="0 0 0")
    _inside(inertial, "mass", value=_word(vehicle.mass))
    turned = square(to_flu_matrix(square(vehicle.inertia, 3)), 3)
    places = {"xx": (0, 0), "xy": (0, 1), "xz": (0, 2), "yy": (1, 1), "yz": (1, 2), "zz": (2, 2)}
    _inside(inertial, "inertia", **{f"i{key}": _word(turned[row][column]) for key, (row, column) in places.items()})
    for mesh in vehicle.meshes:
        link.append(_mesh(mesh))
    if not vehicle.meshes:
        _shape(link, "visual", "box", HULL, size=_words(vehicle.dimensions))
    _shape(link, "collision", "box", size=_words(vehicle.dimensions))
    return link


def _mesh(mesh: Mesh) -> Element:
    """Return the `<visual>` of a mesh, whose orientation is relative to FRD axes."""
    ahead, *others = pose_at((0.0, 0.0, 0.0), mesh.orientation).rotation
    angles = Pose([ahead, *([-x for x in row] for row in others)]).angles()  # in FLU
    visual = Element("visual")
    _inside(visual, "origin", xyz=_words(to_flu(mesh.position)), rpy=_words(angles))
    file = mesh.file if "://" in mesh.file else f"file://{mesh.file}"
    _inside(_inside(visual, "geometry"), "mesh", filename=file, scale=_words(mesh.scale))
    return visual


def _add_thruster(robot: Element, thruster: Thruster, base: str, prefix: str) -> None:
    """Add a thruster's link, which turns about its own x axis, the direction of its thrust."""
    axis = to_flu(thruster.unit_direction)
    link = _inside(robot, "link", name=f"{prefix}{thruster.name}_link")  # the hull has the whole mass
    length, radius = PROPELLER[0], 0.5 * thruster.diameter if thruster.diameter else PROPELLER[1]
    visual = _shape(link, "visual", "cylinder", THRUSTER, radius=_word(radius), length=_word(length))
    _inside(visual, "origin", xyz="0 0 0", rpy=_words((0.0, acos(0.0), 0.0)))  # a cylinder's axis is z
    joint = _joint(robot, thruster.name, "continuous", base, link.get("name", ""))
    turn = 0.0, asin(max(-1.0, min(1.0, -axis[2]))), atan2(axis[1], axis[0])
    _inside(joint, "origin", xyz=_words(to_flu(thruster.position)), rpy=_words(turn))
    _inside(joint, "axis", xyz="1 0 0")
    plugin = _inside(
        _inside(robot, "gazebo"), "plugin", name="gz::sim::systems::Thruster", filename="gz-sim-thruster-system"
    )
    _inside(plugin, "joint_name").text = thruster.name
    _inside(plugin, "max_thrust_cmd").text = _word(thruster.max_forward)
    _inside(plugin, "min_thrust_cmd").text = _word(-thruster.max_reverse)
    if thruster.time_constant:
        _inside(_inside(plugin, "dynamics"), "timeConstant").text = _word(thruster.time_constant)


def _add_fin(robot: Element, fin: Fin, base: str, prefix: str) -> None:
    """Add a fin's link, a plate of its area, and its joint, which turns as a positive deflection does."""
    link = _inside(robot, "link", name=f"{prefix}{fin.name}_link")
    chord, normal = (to_flu(vector) for vector in fin.frame)
    axis = [component / hypot(*fin.axis) for component in to_flu(fin.axis)]
    chord_m = max(fin.area, MIN_AREA) ** 0.5 if not fin.aspect_ratio else (fin.area / fin.aspect_ratio) ** 0.5
    size = _words((chord_m, fin.area / chord_m, FIN_THICKNESS))
    visual = _shape(link, "visual", "box", FIN, size=size)
    _inside(visual, "origin", xyz="0 0 0", rpy=_words(_angles(chord, axis, [-x for x in normal])))
    joint = _joint(robot, fin.name, "revolute", base, link.get("name", ""))
    _inside(joint, "origin", xyz=_words(to_flu(fin.position)), rpy="0 0 0")
    _inside(joint, "axis", xyz=_words(axis))
    _add_lift(robot, fin, link.get("name", ""), chord, normal)
    limit = _word(fin.max_deflection)
    _inside(joint, "limit", lower=f"-{limit}", upper=limit, effort=_word(EFFORT), velocity=_word(fin.rate or RATE))


def _add_lift(robot: Element, fin: Fin, link: str, chord: Sequence[float], normal: Sequence[float]) -> None:
    """Add the plugin of a fin's lift. Gazebo's drag grows with the angle, ours with the square of the lift."""
    name = "gz::sim::systems::LiftDrag"
    plugin = _inside(_inside(robot, "gazebo"), "plugin", name=name, filename="gz-sim-lift-drag-system")
    polar = fin.polar
    numbers = {
        "area": fin.area, "cla": polar.lift_slope, "alpha_stall": fin.stall_angle, "a0": 0.0, "air_density": DENSITY,
        "cda": polar.induced_drag * polar.lift_slope**2 * fin.stall_angle / 1.25,
    }  # fmt: skip
    _inside(plugin, "link_name").text = link
    for tag, number in numbers.items():
        _inside(plugin, tag).text = _word(number)
    _inside(plugin, "forward").text, _inside(plugin, "upward").text = _words(chord), _words(normal)
    own = {key: value for key, value in fin._asdict().items() if isinstance(value, (int, float)) and key not in _TAGGED}
    _inside(plugin, OWN, **{key: repr(value) for key, value in own.items()})


def _add_water(robot: Element, vehicle: Vehicle, base: str) -> None:
    """Add volume, box, added mass and damping with the tags of uuv_simulator, where damping is negative."""
    plugin = _inside(
        _inside(robot, "gazebo"), "plugin", name="uuv_plugin", filename="libuuv_underwater_object_ros_plugin.so"
    )
    link = _inside(plugin, "link", name=base)
    _inside(link, "neutrally_buoyant").text = str(int(vehicle.neutrally_buoyant))
    _inside(link, "volume").text = _word(vehicle.volume)
    _inside(link, "center_of_buoyancy").text = _words(to_flu(vehicle.center_of_buoyancy))
    box = _inside(link, "box")
    for side, size in zip(("length", "width", "height"), vehicle.dimensions, strict=True):
        _inside(box, side).text = _word(size)
    model = _inside(link, "hydrodynamic_model")
    _inside(model, "type").text = "fossen"
    for key, sign in (("added_mass", 1.0), ("linear_damping", -1.0), ("quadratic_damping", -1.0)):
        turned = square(to_flu_matrix(square(getattr(vehicle, key), 6)), 6)
        _inside(model, key).text = _words([sign * x for row in turned for x in row])


def _joint(robot: Element, name: str, kind: str, parent: str, child: str) -> Element:
    joint = _inside(robot, "joint", name=name, type=kind)
    _inside(joint, "parent", link=parent)
    _inside(joint, "child", link=child)
    return joint


def _shape(link: Element, tag: str, kind: str, colour: str = "", **sizes: str) -> Element:
    shape = _inside(link, tag)
    _inside(_inside(shape, "geometry"), kind, **sizes)
    if colour:
        _inside(_inside(shape, "material", name=f"colour {colour}"), "color", rgba=colour)
    return shape


def _inside(parent: Element, tag: str, **attributes: str) -> Element:
    return ElementTree.SubElement(parent, tag, attributes)


def _angles(x: Sequence[float], y: Sequence[float], z: Sequence[float]) -> tuple[float, float, float]:
    """Return roll, pitch and yaw of three axes, which are perpendicular unit vectors."""
    return Pose(transpose([list(x), list(y), list(z)])).angles()


def _words(numbers: Sequence[float]) -> str:
    return " ".join(map(_word, numbers))


def _word(number: float) -> str:
    return repr(float(number) + 0.0)
