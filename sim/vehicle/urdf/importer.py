"""Import a vehicle from a URDF or SDF: masses and poses from its links, hydrodynamics from its simulator's tags.

URDF's axes are x forward, y to port, z up (FLU), ours x forward, y to starboard, z down (FRD). The conversion is half a
turn about x, and only `to_frd` and `to_frd_matrix` do it. Besides plain URDF this module reads

* the plugins of uuv_simulator: `<hydrodynamic_model>` with its volume, centre of buoyancy and box, thrusters;
* the systems of Gazebo (gz-sim): hydrodynamics (`xDotU`, `xU`, `xUabsU` ...) and thruster, and SDFormat's
  `<fluid_added_mass>` of a link.

A URDF without such tags has no hydrodynamics. Missing values are never guessed: an error lists their keys.
"""

import os
from collections.abc import Iterator, Sequence
from functools import partial
from math import degrees, hypot
from typing import Annotated, Any, NamedTuple

from hil.common.errors import ConfigError
from hil.common.schema import Range, convert
from sim.matrices import Matrix, cross_matrix, product, square, total, transpose
from sim.vehicle.meshes import Mesh
from sim.vehicle.urdf.fins import read_fins
from sim.vehicle.urdf.hull import Tree, add_up, without_dust
from sim.vehicle.urdf.pose import Pose
from sim.vehicle.urdf.sensors import read_sensors
from sim.vehicle.urdf.shapes import Measure, box_of, extent_of, from_collisions, mesh_key, origin_of
from sim.vehicle.urdf.text import Element, attribute, listed, number_of, plain, read_xml, to_frd, to_frd_matrix
from sim.vehicle.urdf.thrusters import read_thrusters, target
from sim.vehicle.urdf.water import read_buoyancy_engine, read_munk_share, read_water, water_elements
from sim.vehicle.vehicle import Vehicle, parse_vehicle

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


ALONG = 0.9  # a thruster pushes along x if so much of its direction does
USUAL_SPEED = 1.5  # m/s; of an underwater vehicle whose thrust is not known
_MASS = Annotated[float, Range(0.0, 1e6, "kg")]
_ZERO = ("added_mass", "linear_damping", "quadratic_damping")
_MOST = 0.999  # of the sum of two moments of inertia, for the third one
_STEPS = 200  # of a power iteration


class Imported(NamedTuple):
    """An imported model: the vehicle, its sensors as a scenario's tables, and notes on what was assumed or left out."""

    vehicle: Vehicle
    sensors: dict[str, dict[str, Any]]
    notes: list[str]


class _Model(NamedTuple):
    """A model being imported: its `<robot>`, the pose of each link, its file, and the keys that the user gave.

    `measure` measures mesh files; `notes` collects what was assumed.
    """

    robot: Element
    poses: dict[str, Pose]
    path: str
    user_keys: dict[str, Any]
    measure: Measure
    notes: list[str]


def read_urdf(path: str, extra: dict[str, Any] | None = None, text: bytes | None = None) -> tuple[Vehicle, list[str]]:
    """Return the vehicle of the URDF at `path`, and notes on what was assumed.

    `extra` has further keys of a vehicle file; they have priority over the URDF, `[every_thruster]` for each thruster.
    `text` is read in place of the file, for example after xacro has expanded it. The origin is that of the hull.
    Raises ConfigError if the file is no URDF, still contains xacro, declares entities, or if keys are missing from
    both: it lists them.
    """
    imported = read_robot(read_xml(path, text), path, extra)
    return imported.vehicle, imported.notes


def read_robot(
    robot: Element, path: str, extra: dict[str, Any] | None = None, measure: Measure = lambda meshes: {}
) -> Imported:
    """Return the vehicle of a `<robot>` of the file at `path`, its sensors, and notes. See `read_urdf`.

    `measure` returns volumes and boxes of mesh files, for models whose buoyancy is given only by their collisions.
    """
    notes: list[str] = []
    poses = _link_poses(robot, path)
    tree = tree_of(robot, path)
    root = next(iter(poses))
    hull = tree.hull(root)
    poses = _ahead(robot, _about(poses, root, hull, notes), path, notes)
    user_keys = dict(extra or {})
    table = _table(_Model(robot, poses, path, user_keys, measure, notes), tree, hull)
    given_thrusters, given_fins = (_rows(user_keys.pop(key, []), key, path) for key in ("thrusters", "fins"))
    (common,) = _rows([user_keys.pop("every_thruster", {})], "every_thruster", path)
    meshes = list(_meshes(robot, poses, path))
    thrusters = [thruster | common for thruster in read_thrusters(robot, poses, path, notes)]
    thrusters = [common | thruster for thruster in given_thrusters] or thrusters
    fins = read_fins(robot, poses, path, {str(fin.get("name")) for fin in given_fins}, notes) + given_fins
    if fins:
        user_keys["fins"] = fins
    table = {**table, **user_keys, "thrusters": thrusters}
    _derive_limits(table, notes)
    _refuse_missing(table, path)
    vehicle = parse_vehicle(table, path)._replace(meshes=tuple(meshes))
    return Imported(vehicle, read_sensors(robot, poses, path, notes), notes)


def _about(poses: dict[str, Pose], root: str, hull: str, notes: list[str]) -> dict[str, Pose]:
    """Return the links' poses relative to the origin of the hull, in the axes of the root."""
    at = poses[hull]
    turned = [round(degrees(angle), 3) + 0.0 for angle in at.angles()]
    if any(at.position) or any(turned):
        where = f"{listed(at.position)} m in {plain(root)!r}, whose axes (here FLU) are the vehicle's"
        notes.append(
            f"The origin is that of {plain(hull)!r}, the hull, at {where}"
            + (f"; the hull is turned by roll, pitch, yaw {listed(turned)} deg." if any(turned) else ".")
        )
    back = Pose(position=tuple(-x for x in at.position))
    return {link: back.then(pose) for link, pose in poses.items()}


def _ahead(robot: Element, poses: dict[str, Pose], path: str, notes: list[str]) -> dict[str, Pose]:
    """Return the poses with the bow along x: turned if all propellers along x are at that end and push to the other."""
    rows = [(row["position"][0], row["direction"][0]) for row in read_thrusters(robot, poses, path, [])]
    along = [(place, push) for place, push in rows if abs(push) > ALONG]
    if not along or any(place <= 0.0 or push > 0.0 for place, push in along):
        return poses
    notes.append("The model faces its own -x, to which its propellers push: it is turned by 180 deg about z.")
    turn = Pose([[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]])
    return {link: turn.then(pose) for link, pose in poses.items()}


def _table(model: _Model, tree: Tree, hull: str) -> dict[str, Any]:
    """Return the keys of the model, except thrusters and fins."""
    robot, poses, path, user_keys, measure, notes = model
    table: dict[str, Any] = {
        "name": plain(robot.get("name") or "vehicle"),
        "source": f"imported from {plain(os.path.basename(path))}",
    }
    waters = read_water(robot, hull, partial(box_of, robot, path, measure), path, notes)
    table |= _mass(robot, poses, path, notes) | add_up(waters, poses, tree, hull, notes)
    table |= read_buoyancy_engine(robot, poses, path) | read_munk_share(robot, notes)
    mass = convert(user_keys["mass"], _MASS, f"{path}: mass") if "mass" in user_keys else table.get("mass")
    if table.pop("neutral") and mass is not None:
        table["neutrally_buoyant"] = True
        table.setdefault("volume", mass / 1000.0)
    if "mass" in user_keys and "inertia" in table and "inertia" not in user_keys:
        notes.append("The mass is the one given, the inertia still that of the URDF.")
    files = [plugin.get("filename", "").lower() for plugin in robot.iter("plugin")]
    # With the hydrodynamics of Gazebo, the buoyancy is that of the collision shapes.
    by_shapes = any("hydrodynamics" in file or "buoyancy-system" in file for file in files)
    if by_shapes or robot.find(".//hydrodynamic_model") is not None:
        _add_shapes(table, model, by_shapes)
        lost = [key for key in _ZERO if key not in table and key not in user_keys]
        if lost and len(lost) < len(_ZERO):
            table |= dict.fromkeys(lost, [0.0] * 6)
            notes.append(f"The model does not say {', '.join(lost)}: 0, as its simulator has it.")
    return table


def _add_shapes(table: dict[str, Any], model: _Model, with_volume: bool) -> None:
    """Add what follows from the shapes of the model: volume, centre of buoyancy, and bounding box."""
    robot, poses, path, user_keys, measure, notes = model
    known = table.keys() | user_keys.keys()
    if with_volume and not {"volume", "center_of_buoyancy"} <= known:
        shape_keys = from_collisions(robot, poses, path, measure, notes)
        shape_keys = {key: value for key, value in shape_keys.items() if key not in known}
        if "volume" in shape_keys:
            notes.append(
                f"The volume, {shape_keys['volume']:.6g} m³, is that of the collisions, as Gazebo's buoyancy has it."
            )
        table |= shape_keys
    if "dimensions" not in known:
        table |= extent_of(robot, poses, path, measure)
        if "dimensions" in table:
            notes.append("The dimensions are those of the box around what is visible.")


def _rows(rows: Any, key: str, path: str) -> list[dict[str, Any]]:
    """Return the tables that are given under a key. Raises ConfigError."""
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise ConfigError(f"{path}: {key}: expected a table or tables")
    return rows


def _link_poses(robot: Element, path: str) -> dict[str, Pose]:
    """Return each link's pose in the root link, all joints at zero."""
    links = [link.get("name", "") for link in robot.findall("link")]
    joints = {target(joint, "child"): joint for joint in robot.findall("joint")}
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
            link = target(joints[link], "parent")
        for below in reversed(chain):
            poses[below] = poses[target(joints[below], "parent")].then(origin_of(joints[below], path))
    return poses


def tree_of(robot: Element, path: str) -> Tree:
    """Return the tree of a robot's links."""
    masses = {}
    for link in robot.findall("link"):
        where = f"{path}: link {link.get('name', '')!r}: <inertial>: <mass value>"
        masses[link.get("name", "")] = number_of(attribute(link, "inertial/mass", "value", "0"), where)
    wet = frozenset(masses.keys() & {link for link, _, _ in water_elements(robot)})
    parents = {
        target(joint, "child"): (target(joint, "parent"), joint.get("type") == "fixed")
        for joint in robot.findall("joint")
    }
    return Tree(masses, wet, parents)


def _mass(robot: Element, poses: dict[str, Pose], path: str, notes: list[str]) -> dict[str, Any]:
    """Return mass, centre of gravity and inertia about it, of all links together; missing ones are left out."""
    masses = []
    for link in robot.findall("link"):
        inertial = link.find("inertial")
        if inertial is not None:
            where = f"{path}: link {link.get('name', '')!r}: <inertial>"
            at = poses[link.get("name", "")].then(origin_of(inertial, where))
            mass = number_of(attribute(inertial, "mass", "value"), f"{where}: <mass value>")
            moments = product(product(at.rotation, _inertia(inertial, f"{where}: <inertia>")), transpose(at.rotation))
            masses.append((mass, at.position, moments))
    masses.sort()  # so that the order of the links changes no rounding
    mass = sum(part[0] for part in masses)
    if mass <= 0.0:
        return {}
    centre = [sum(part[0] * part[1][axis] for part in masses) / mass for axis in range(3)]
    inertia = square([0.0] * 3, 3)
    for part_mass, position, own in masses:
        lever = cross_matrix([a - b for a, b in zip(position, centre, strict=True)])
        inertia = total(total(inertia, own), product(lever, lever), -part_mass)  # parallel axes
    keys: dict[str, Any] = {"mass": mass, "center_of_gravity": to_frd(centre)}
    given = any(x for _, _, own in masses for row in own for x in row)
    return keys | {"inertia": to_frd_matrix(without_dust(_possible(inertia, notes)))} if given else keys


def _possible(inertia: Matrix, notes: list[str]) -> Matrix:
    """Return an inertia whose greatest principal moment is below the other two together; simulators accept any."""
    axis = [[1.0], [0.9], [0.8]]
    for _ in range(_STEPS):  # converges to the axis of the greatest moment
        axis = product(inertia, axis)
        length = hypot(*(x for (x,) in axis)) or 1.0
        axis = [[x / length] for (x,) in axis]
    moment = product(transpose(axis), product(inertia, axis))[0][0]
    most = _MOST * (sum(inertia[i][i] for i in range(3)) - moment)
    if moment * _MOST <= most or most <= 0.0:
        return inertia
    notes.append(
        f"The greatest moment of inertia is {most:.6g} kg m²: that of the model, {moment:.6g}, is more than the other "
        "two together, as in no body."
    )
    return total(inertia, product(axis, transpose(axis)), most - moment)


def _inertia(inertial: Element, path: str) -> Matrix:
    xx, yy, zz, xy, xz, yz = (
        number_of(attribute(inertial, "inertia", f"i{key}", "0"), path) for key in ("xx", "yy", "zz", "xy", "xz", "yz")
    )
    return [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]


def _meshes(robot: Element, poses: dict[str, Pose], path: str) -> Iterator[Mesh]:
    """Yield the visible meshes of the links, or the meshes of the collisions if there are none.

    A mesh keeps its own axes (FLU), so its orientation is that of FLU axes in the body's FRD axes.
    """
    kind = "visual" if robot.find("link/visual/geometry/mesh") is not None else "collision"
    for link in robot.findall("link"):
        for visual in link.findall(kind):
            shape = visual.find("geometry/mesh")
            if shape is None:
                continue
            pose = poses[link.get("name", "")].then(origin_of(visual, path))
            ahead, *others = pose.rotation  # to FLU; with the last two rows negated, to FRD
            angles = Pose([ahead, *([-x for x in row] for row in others)]).angles()
            file, scale = mesh_key(shape, path)
            yield Mesh(file, _three(to_frd(pose.position)), angles, _three(scale))


def _three(numbers: Sequence[float]) -> tuple[float, float, float]:
    x, y, z = numbers
    return x, y, z


def _derive_limits(table: dict[str, Any], notes: list[str]) -> None:
    """Give thrusters without limits those that reach `USUAL_SPEED` ahead and hold the depth; `notes` says so.

    Simulators have no limit where a model gives none. Nothing is derived if the hull's drag or volume is not known.
    """
    thrusters = table["thrusters"]
    lacking = [row for row in thrusters if "max_forward" not in row]
    if any(key not in table for key in _REQUIRED) or not thrusters:
        return
    ahead, down = (sum(abs(row["direction"][axis]) / hypot(*row["direction"]) for row in thrusters) for axis in (0, 2))
    drags = (table[key] for key in ("linear_damping", "quadratic_damping", "forward_speed_damping") if key in table)
    values = [table["mass"], table["volume"], *(drag[0] for drag in drags)]
    if lacking and ahead > 0.1 and all(isinstance(value, (int, float)) for value in values) and any(values[2:]):
        mass, volume, linear, *quadratic = values
        surge = (linear + sum(quadratic) * USUAL_SPEED) * USUAL_SPEED / ahead
        heave = 2.0 * abs(mass - 1000.0 * volume) * 9.81 / down if down > 0.1 else 0.0
        limit = float(f"{max(surge, heave):.3g}")
        for row in lacking:
            row["max_forward"] = limit
        notes.append(
            f"The model does not say max_forward of {len(lacking)} thrusters: {limit:g} N, for {USUAL_SPEED:g} m/s "
            "ahead; give yours in [every_thruster] of --add."
        )
    for row in thrusters:
        if "max_reverse" not in row and "max_forward" in row:
            row["max_reverse"] = row["max_forward"]


def _refuse_missing(table: dict[str, Any], path: str) -> None:
    missing = [key for key in _REQUIRED if key not in table]
    if not table["thrusters"]:
        missing.append("[[thrusters]]")
    limits = [key for key in ("max_forward", "max_reverse") if any(key not in t for t in table["thrusters"])]
    missing += [f"[every_thruster] {key}" for key in limits]
    if missing:
        raise ConfigError(f"{path}: does not say {', '.join(missing)}: write them in a TOML file and --add it")
