"""Compute volume, centre of volume and bounding box of a model's shapes, as Gazebo's buoyancy system does."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from math import inf, pi
from typing import Any, NamedTuple

from sim.vehicle.urdf.pose import Pose, pose_at
from sim.vehicle.urdf.text import Element, attribute, find_mesh, number_of, numbers_of, to_frd

MIN_SIDE = 0.01  # m: least dimension of a vehicle


class Solid(NamedTuple):
    """A shape in its own axes: volume in m³, centre of volume and both corners of its bounding box in m."""

    volume: float
    centre: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    is_closed: bool = True


MeshKey = tuple[str, tuple[float, ...]]  # the file, and the three scale factors of its coordinates
Measure = Callable[[Sequence[MeshKey]], Mapping[MeshKey, Solid]]  # meshes that cannot be measured are left out


def origin_of(element: Element, path: str) -> Pose:
    """Return the `<origin>` of an element. Raises ConfigError."""
    place, turn = (numbers_of(attribute(element, "origin", key, "0 0 0"), path, 3) for key in ("xyz", "rpy"))
    return pose_at(place, turn)


def mesh_key(shape: Element, path: str) -> MeshKey:
    """Return the file and the scale of a `<mesh>`."""
    return find_mesh(shape.get("filename") or "", path), tuple(numbers_of(shape.get("scale") or "1 1 1", path, 3))


def from_collisions(
    robot: Element, poses: Mapping[str, Pose], path: str, measure: Measure, notes: list[str]
) -> dict[str, Any]:
    """Return volume and centre of buoyancy of all collisions together, {} if they have no volume."""
    volume, moment = 0.0, [0.0, 0.0, 0.0]
    for solid, pose in _solids(robot, poses, path, measure, "collision"):
        volume += solid.volume
        if not solid.is_closed:
            notes.append("A mesh of the collisions is not closed: the volume may be wrong.")
        moment = [a + solid.volume * x for a, x in zip(moment, pose.transform(solid.centre), strict=True)]
    if volume <= 0.0:
        return {}
    return {"volume": volume, "center_of_buoyancy": to_frd([x / volume for x in moment])}


def extent_of(robot: Element, poses: Mapping[str, Pose], path: str, measure: Measure) -> dict[str, Any]:
    """Return the dimensions (m) of the box around all that is visible; around the collisions if nothing is."""
    for kind in ("visual", "collision"):
        low, high = [inf] * 3, [-inf] * 3
        for solid, pose in _solids(robot, poses, path, measure, kind):
            for corner in range(8):
                at = [(solid.high if corner >> axis & 1 else solid.low)[axis] for axis in range(3)]
                place = pose.transform(at)
                low, high = list(map(min, low, place)), list(map(max, high, place))
        if low[0] < inf:
            return {"dimensions": [max(b - a, MIN_SIDE) for a, b in zip(low, high, strict=True)]}
    return {}


def box_of(robot: Element, path: str, measure: Measure, link: str) -> list[float] | None:
    """Return the sides (m) of the box around one link's shapes in its own axes, None if it has none."""
    alone = Element("robot")
    alone.extend(each for each in robot.findall("link") if each.get("name") == link)
    return extent_of(alone, {link: Pose()}, path, measure).get("dimensions")


def _solids(
    robot: Element, poses: Mapping[str, Pose], path: str, measure: Measure, kind: str
) -> Iterator[tuple[Solid, Pose]]:
    shapes = []
    for link in robot.findall("link"):
        for element in link.findall(kind):
            geometry = element.find("geometry")
            if geometry is not None:
                pose = poses[link.get("name", "")].then(origin_of(element, path))
                shapes += [(shape, pose, mesh_key(shape, path) if shape.tag == "mesh" else None) for shape in geometry]
    meshes = measure(sorted({key for _, _, key in shapes if key is not None}))
    for shape, pose, key in shapes:
        solid = _primitive(shape, path) if key is None else meshes.get(key)
        if solid is not None:
            yield solid, pose


def _primitive(shape: Element, path: str) -> Solid | None:
    """Return the volume and box of one of SDF's and URDF's own shapes."""

    def of(key: str) -> float:
        return abs(number_of(shape.get(key) or "0", path))

    if shape.tag == "box":
        half = [0.5 * abs(x) for x in numbers_of(shape.get("size") or "", path, 3)]
        return _centred(8.0 * half[0] * half[1] * half[2], half)
    if shape.tag == "ellipsoid":
        radii = [abs(x) for x in numbers_of(shape.get("radii") or "", path, 3)]
        return _centred(4.0 / 3.0 * pi * radii[0] * radii[1] * radii[2], radii)
    if shape.tag in ("sphere", "cylinder", "capsule"):
        radius, length = of("radius"), of("length") if shape.tag != "sphere" else 0.0
        ends = radius if shape.tag != "cylinder" else 0.0
        volume = pi * radius**2 * length + 4.0 / 3.0 * pi * ends**3
        return _centred(volume, [radius, radius, 0.5 * length + ends])
    return None


def _centred(volume: float, half: Sequence[float]) -> Solid:
    return Solid(volume, (0.0, 0.0, 0.0), tuple(-x for x in half), tuple(half))
