"""Import a vehicle from a URDF: masses and thruster poses from its tree, hydrodynamics from its simulator's tags.

URDF's axes are x forward, y to port, z up (FLU), ours x forward, y to starboard, z down (FRD): half a turn
about x, done in `to_frd` and `to_frd_matrix` and nowhere else. Read are, besides plain URDF,

* the plugins of uuv_simulator: `<hydrodynamic_model>` with its volume, centre of buoyancy and box, thrusters;
* the systems of Gazebo (gz-sim): hydrodynamics (`xDotU`, `xU`, `xUabsU` ...) and thruster, and SDFormat's
  `<fluid_added_mass>` of a link.

A URDF without such tags says nothing of water; what is missing is asked for by name, never guessed.
"""

import os
from collections.abc import Iterator, Sequence
from math import asin, atan2, cos, sin
from typing import Annotated, Any, NamedTuple

from hil.common.errors import ConfigError
from hil.common.schema import Range, parse
from sim.matrices import Matrix, cross_matrix, product, square, total, transpose
from sim.vehicle.meshes import Mesh
from sim.vehicle.urdf.fins import left_out
from sim.vehicle.urdf.pose import Pose
from sim.vehicle.urdf.text import (
    Element,
    attribute,
    child_text,
    find_mesh,
    number_of,
    numbers_of,
    plain,
    read_xml,
    to_frd,
    to_frd_matrix,
)
from sim.vehicle.vehicle import EQUIPMENT, Vehicle, with_equipment

_REQUIRED = (
    "mass",
    "inertia",
    "volume",
    "dimensions",
    "center_of_buoyancy",
    "added_mass",
    "linear_damping",
    "quadratic_damping",
)
_ROWS, _COLUMNS, _ADDED = "xyzkmn", "UVWPQR", "xyzpqr"


def read_urdf(path: str, extra: dict[str, Any] | None = None, text: bytes | None = None) -> tuple[Vehicle, list[str]]:
    """Return the vehicle of the URDF at `path`, and notes of what was assumed.

    `extra` holds keys of a vehicle file that the URDF lacks; they win over what it has, `[every_thruster]`
    for each thruster. `text` is read in place of the file, as when xacro has expanded it. The origin is the root
    link's. Raises ConfigError if the file is no URDF, still is xacro, declares entities, or if keys are missing
    from both: it lists them.
    """
    robot = read_xml(path, text)
    notes: list[str] = []
    poses = _link_poses(robot, path)
    table: dict[str, Any] = {
        "name": plain(robot.get("name") or "vehicle"),
        "source": f"imported from {plain(os.path.basename(path))}",
    }
    given = dict(extra or {})
    table |= _mass(robot, poses, path) | _water(robot, path)
    neutral, mass = table.pop("neutral", False), _given_mass(given, path) or table.get("mass")
    if neutral and mass is not None:
        table["neutrally_buoyant"] = True
        table.setdefault("volume", mass / 1000.0)
    if "mass" in given and "inertia" in table and "inertia" not in given:
        notes.append("The mass is the one given, the inertia still that of the URDF.")
    common = given.pop("every_thruster", {})
    meshes = list(_meshes(robot, poses, path))
    thrusters = [thruster | common for thruster in _thrusters(robot, poses, path, notes)]
    thrusters = [common | thruster for thruster in given.pop("thrusters", ())] or thrusters
    table = {**table, **given, "thrusters": thrusters}
    _refuse_missing(table, path)
    equipment = {key: table.pop(key) for key in EQUIPMENT if key in table}
    vehicle = parse(table, Vehicle, path)._replace(meshes=tuple(meshes))
    if equipment:
        vehicle = with_equipment(vehicle, equipment, path)
    notes += left_out(robot, poses, {fin.name for fin in vehicle.fins})
    return vehicle, notes


def _link_poses(robot: Element, path: str) -> dict[str, Pose]:
    """Return each link's pose in the root link, all joints at zero."""
    links = [link.get("name", "") for link in robot.findall("link")]
    joints = {_target(joint, "child"): joint for joint in robot.findall("joint")}
    roots = [link for link in links if link not in joints]
    if len(roots) != 1:
        raise ConfigError(f"{path}: the links make no tree: {len(roots)} of them hang on no other")
    poses = {roots[0]: Pose()}
    for link in links:
        chain = []
        while link not in poses:
            if link in chain or link not in joints:
                raise ConfigError(f"{path}: link {link!r} does not hang on {roots[0]!r}; join them by joints")
            chain.append(link)
            link = _target(joints[link], "parent")
        for below in reversed(chain):
            poses[below] = poses[_target(joints[below], "parent")].then(_origin(joints[below], path))
    return poses


def _mass(robot: Element, poses: dict[str, Pose], path: str) -> dict[str, Any]:
    """Mass, centre of gravity and inertia about it, of all links together; what they do not say is left out."""
    parts = []
    for link in robot.findall("link"):
        inertial = link.find("inertial")
        if inertial is not None:
            at = poses[link.get("name", "")].then(_origin(inertial, path))
            mass = number_of(attribute(inertial, "mass", "value"), path)
            parts.append((mass, at.position, _turned(_inertia(inertial, path), at.rotation)))
    mass = sum(part[0] for part in parts)
    if mass <= 0.0:
        return {}
    centre = [sum(part[0] * part[1][axis] for part in parts) / mass for axis in range(3)]
    inertia = square([0.0] * 3, 3)
    for part_mass, position, own in parts:
        lever = cross_matrix([a - b for a, b in zip(position, centre, strict=True)])
        inertia = total(total(inertia, own), product(lever, lever), -part_mass)  # parallel axes
    keys: dict[str, Any] = {"mass": mass, "center_of_gravity": to_frd(centre)}
    given = any(x for _, _, own in parts for row in own for x in row)
    return keys | {"inertia": to_frd_matrix(inertia)} if given else keys


class _Mass(NamedTuple):
    mass: Annotated[float, Range(0.0, 1e6, "kg")]


def _given_mass(given: dict[str, Any], path: str) -> float | None:
    """Return the mass (kg) that is given beside the URDF, if it is."""
    return parse({"mass": given["mass"]}, _Mass, path).mass if "mass" in given else None


def _inertia(inertial: Element, path: str) -> Matrix:
    xx, yy, zz, xy, xz, yz = (
        number_of(attribute(inertial, "inertia", f"i{key}", "0"), path) for key in ("xx", "yy", "zz", "xy", "xz", "yz")
    )
    return [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]


def _turned(inertia: Matrix, rotation: Matrix) -> Matrix:
    return product(product(rotation, inertia), transpose(rotation))


def _thrusters(robot: Element, poses: dict[str, Pose], path: str, notes: list[str]) -> list[dict[str, Any]]:
    """Return a thruster for each thruster plugin; failing those, for each turning joint of a link called so."""
    joints = {joint.get("name", ""): joint for joint in robot.findall("joint")}
    thrusters = []
    for plugin in robot.iter("plugin"):
        name = child_text(plugin, "jointName", "joint_name")
        if "thruster" not in plugin.get("filename", "") or not name:
            continue
        if name not in joints:
            raise ConfigError(f"{path}: a thruster plugin names the joint {name!r}, which is not there")
        thrusters.append(_thruster_pose(joints[name], poses, path) | _thruster_limits(plugin, path))
    if not thrusters:
        turning = [joint for joint in joints.values() if joint.get("type") == "continuous"]
        named = [joint for joint in turning if "thruster" in _target(joint, "child")]
        thrusters = [_thruster_pose(joint, poses, path) for joint in named]
        notes += ["No thruster plugin: every turning joint of a link named thruster is one."] if thrusters else []
    return thrusters


def _thruster_pose(joint: Element, poses: dict[str, Pose], path: str) -> dict[str, Any]:
    pose = poses.get(_target(joint, "child"))
    if pose is None:
        raise ConfigError(f"{path}: the link {_target(joint, 'child')!r} of a thruster is not there")
    axis = numbers_of(attribute(joint, "axis", "xyz", "1 0 0"), path, 3)
    return {
        "name": plain(_target(joint, "child").rsplit("/", 1)[-1]).removesuffix("_link"),
        "position": to_frd(pose.position),
        "direction": to_frd(pose.turn(tuple(axis))),
    }


def _thruster_limits(plugin: Element, path: str) -> dict[str, float]:
    most, least = child_text(plugin, "thrust_max", "max_thrust_cmd"), child_text(plugin, "thrust_min", "min_thrust_cmd")
    lag = plugin.findtext("dynamics/timeConstant")
    texts = {"max_forward": most, "max_reverse": least, "time_constant": lag}
    return {key: abs(number_of(text, path)) for key, text in texts.items() if text is not None}


def _water(robot: Element, path: str) -> dict[str, Any]:
    """Return what the tags of a simulator say of volume, box, added mass and damping."""
    keys: dict[str, Any] = {}
    for inertial in robot.iter("inertial"):
        added = inertial.find("fluid_added_mass")
        if added is not None:
            keys["added_mass"] = to_frd_matrix(_fluid_added_mass(added, path))
    for element in robot.iter():
        if element.tag == "hydrodynamics" or "hydrodynamics" in element.get("filename", ""):
            keys = _gazebo_water(element, path) | keys
        elif element.tag == "link" and element.find("hydrodynamic_model") is not None:
            keys |= _uuv_water(element, path)
    return keys


def _fluid_added_mass(added: Element, path: str) -> Matrix:
    """SDFormat 1.10: the upper triangle as <xx> <xy> ... <rr>, positive."""

    def entry(i: int, j: int) -> float:
        return number_of(added.findtext(_ADDED[min(i, j)] + _ADDED[max(i, j)]) or "0", path)

    return [[entry(i, j) for j in range(6)] for i in range(6)]


def _gazebo_water(element: Element, path: str) -> dict[str, Any]:
    """Stability derivatives by Fossen's names, negative where they brake; a kind not there at all is left out."""
    forms = {"added_mass": "{0}Dot{1}", "linear_damping": "{0}{1}", "quadratic_damping": "{0}{1}abs{1}"}
    keys = {}
    for key, form in forms.items():
        texts = [[element.findtext(form.format(row, column)) for column in _COLUMNS] for row in _ROWS]
        if any(text is not None for row in texts for text in row):
            keys[key] = to_frd_matrix([[-number_of(text or "0", path) for text in row] for row in texts])
    return keys


def _uuv_water(link: Element, path: str) -> dict[str, Any]:
    """Return the water keys of uuv_simulator: added mass positive, damping negative, each as 6 or 36 numbers."""
    model = link.find("hydrodynamic_model")
    keys: dict[str, Any] = {}
    for key, sign in (("added_mass", 1.0), ("linear_damping", -1.0), ("quadratic_damping", -1.0)):
        text = model.findtext(key) if model is not None else None
        if text is not None:
            numbers = [sign * number for number in numbers_of(text, path, 6, 36)]
            keys[key] = to_frd_matrix(square(numbers, 6))
    box = [link.findtext(f"box/{side}") for side in ("length", "width", "height")]
    if None not in box:
        keys["dimensions"] = [number_of(text or "", path) for text in box]
    volume, centre = link.findtext("volume"), link.findtext("center_of_buoyancy")
    if volume is not None:
        keys["volume"] = number_of(volume, path)
    if centre is not None:
        keys["center_of_buoyancy"] = to_frd(numbers_of(centre, path, 3))
    keys["neutral"] = (link.findtext("neutrally_buoyant") or "0").strip() in ("1", "true")
    return keys


def _meshes(robot: Element, poses: dict[str, Pose], path: str) -> Iterator[Mesh]:
    """Yield what the links look like; a mesh keeps its own axes, so its orientation is that of a FLU mesh in FRD."""
    for link in robot.findall("link"):
        for visual in link.findall("visual"):
            shape = visual.find("geometry/mesh")
            if shape is None:
                continue
            pose = poses[link.get("name", "")].then(_origin(visual, path))
            (xx, _, _), (yx, _, _), (zx, zy, zz) = pose.rotation  # to FLU; with the last two rows negative to FRD
            scale = numbers_of(shape.get("scale") or "1 1 1", path, 3)
            yield Mesh(
                find_mesh(shape.get("filename") or "", path),
                _three(to_frd(pose.position)),
                (atan2(-zy, -zz), asin(max(-1.0, min(1.0, zx))), atan2(-yx, xx)),
                _three(scale),
            )


def _three(numbers: Sequence[float]) -> tuple[float, float, float]:
    x, y, z = numbers
    return x, y, z


def _refuse_missing(table: dict[str, Any], path: str) -> None:
    missing = [key for key in _REQUIRED if key not in table]
    if not table["thrusters"]:
        missing.append("[[thrusters]]")
    limits = [key for key in ("max_forward", "max_reverse") if any(key not in t for t in table["thrusters"])]
    missing += [f"[every_thruster] {key}" for key in limits]
    if missing:
        raise ConfigError(f"{path}: does not say {', '.join(missing)}: write them in a TOML file and --add it")


def _origin(element: Element, path: str) -> Pose:
    roll, pitch, yaw = numbers_of(attribute(element, "origin", "rpy", "0 0 0"), path, 3)
    cr, sr, cp, sp, cy, sy = cos(roll), sin(roll), cos(pitch), sin(pitch), cos(yaw), sin(yaw)
    rotation = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    return Pose(rotation, tuple(numbers_of(attribute(element, "origin", "xyz", "0 0 0"), path, 3)))


def _target(joint: Element, side: str) -> str:
    return attribute(joint, side, "link")
