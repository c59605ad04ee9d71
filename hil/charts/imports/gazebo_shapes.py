"""Read the static shapes of a Gazebo world, each with its pose in the world (east, north, up)."""

import os
from collections.abc import Iterator
from typing import NamedTuple

from hil.common.errors import ConfigError
from sim.sdf.files import SdfFiles
from sim.sdf.model import Link, Model, models_of
from sim.vehicle.urdf.pose import Pose
from sim.vehicle.urdf.sdf_pose import own_pose
from sim.vehicle.urdf.text import Element, number_of, numbers_of, plain

_SIZES = {"box": 3, "sphere": 1, "cylinder": 2, "capsule": 2, "cone": 2, "ellipsoid": 3}
_WATER = ("water", "ocean", "wave", "sea_surface", "/surface")  # parts of the names of shapes that show the water
_CLEAR = 0.9  # opacity below which a shape is transparent


class Shape(NamedTuple):
    """One shape: kind ("box", "mesh", "plane", "heightmap" ...), sizes in m (of a mesh: scale factors), pose, file.

    A plane without a size has 0 m. `is_solid`: its link has collisions; what has none is seen, not touched. `is_clear`:
    it is transparent. `colour`: red, green and blue, 0 to 1.
    """

    name: str
    kind: str
    sizes: tuple[float, ...]
    pose: Pose
    file: str = ""
    colour: tuple[float, ...] | None = None
    is_solid: bool = True
    is_clear: bool = False
    element: Element | None = None

    @property
    def is_water(self) -> bool:
        """True if its name is one of water, and it is transparent or not solid."""
        return (self.is_clear or not self.is_solid) and any(word in self.name.lower() for word in _WATER)


def read_shapes(world: Element, folder: str, files: SdfFiles, notes: list[str], version: str) -> list[Shape]:
    """Return the shapes of all static models of a world; what is left out is appended to `notes`."""
    shapes: list[Shape] = []
    moving: list[str] = []
    for model in models_of(world, folder, files, notes, version):
        if model.is_static or _is_welded(model):
            shapes += [shape for link in model.links.values() for shape in _shapes_of_link(model, link, files, notes)]
        else:
            moving.append(model.name)
    if moving:
        notes.append(f"Left out: models that can move: {', '.join(map(plain, moving))}.")
    return shapes


def _is_welded(model: Model) -> bool:
    """True if a joint fixes the model to the world."""
    return any(joint.parent == "world" and joint.kind == "fixed" for joint in model.joints.values())


def _shapes_of_link(model: Model, link: Link, files: SdfFiles, notes: list[str]) -> Iterator[Shape]:
    """Yield the shapes of a link's visuals, or of its collisions if it has no visuals."""
    base = model.pose.then(link.pose)
    solid = link.element.find("collision") is not None
    kind = "visual" if link.element.find("visual") is not None else "collision"
    for part in link.element.findall(kind):
        geometry = part.find("geometry")
        name = f"{plain(model.name)}/{plain(part.get('name') or kind)}"
        if geometry is None or not len(geometry):
            continue
        try:
            place = own_pose(part, files.path)
            place = place._replace(position=tuple([a * b for a, b in zip(place.position, model.scale, strict=True)]))
            shape = _shape(name, geometry[0], base.then(place), link.folder, files)
        except ConfigError as error:
            notes.append(f"Left out: {name}: {error}.")
            continue
        if isinstance(shape, str):
            notes.append(f"Left out: {name}: {shape}.")
        elif shape is not None:
            is_clear = _opacity(part, files.path) < _CLEAR
            yield _scaled(shape, model.scale)._replace(
                is_solid=solid, is_clear=is_clear, colour=_colour(part, files.path)
            )


def _scaled(shape: Shape, scale: tuple[float, ...]) -> Shape:
    """Return a shape with its sizes multiplied by factors along its axes; it stays round."""
    x, y, z = map(abs, scale)
    factors = (x, y, z) if len(shape.sizes) == 3 else (x, y) if shape.kind == "plane" else (max(x, y), z)
    return shape._replace(sizes=tuple([a * b for a, b in zip(shape.sizes, factors, strict=False)]))


def _shape(name: str, element: Element, pose: Pose, folder: str, files: SdfFiles) -> Shape | str | None:
    """Return the shape of a geometry, or the reason why it is left out; None for an empty geometry."""
    kind, path = element.tag, files.path
    if kind in ("mesh", "heightmap"):
        uri = (element.findtext("uri") or "").strip()
        file = files.find(uri, folder)
        if file is None:
            files.missing.append(f"{name}: {kind} {plain(uri)[:100]}")
            return f"the file of the {kind}, {plain(uri)[:100]!r}, was not found"
        scale = numbers_of(element.findtext("scale") or "1 1 1", path, 3) if kind == "mesh" else []
        if kind == "mesh" and element.find("submesh") is not None:
            return "a part of a mesh (<submesh>); save it as a separate file"
        return Shape(name, kind, tuple(scale), pose, os.path.abspath(file), element=element)
    if kind == "plane":
        normal = numbers_of(element.findtext("normal") or "0 0 1", path, 3)
        size = numbers_of(element.findtext("size") or "0 0", path, 2)
        level = abs(pose.rotate(normal)[2]) > 0.999
        return Shape(name, kind, tuple(size), pose) if level else "a plane that is not horizontal"
    if kind == "empty":
        return None
    if kind not in _SIZES:
        return f"the shape <{plain(kind)}> is not supported"
    tags = {"box": ("size",), "ellipsoid": ("radii",), "sphere": ("radius",)}.get(kind, ("radius", "length"))
    sizes = [abs(x) for tag in tags for x in _numbers(element, tag, path)]
    if len(sizes) != _SIZES[kind] or min(sizes) <= 0.0:
        return f"a {kind} without valid sizes"
    return Shape(name, kind, tuple(sizes * 3 if kind == "sphere" else sizes), pose)


def _numbers(element: Element, tag: str, path: str) -> list[float]:
    return [number_of(word, path) for word in (element.findtext(tag) or "").split()]


def _opacity(visual: Element, path: str) -> float:
    """Return the opacity of a visual, 0 to 1; 1 by default."""
    words = (visual.findtext("material/diffuse") or "").split()
    alpha = number_of(words[3], path) if len(words) == 4 else 1.0
    return min(alpha, 1.0 - number_of(visual.findtext("transparency") or "0", path))


def _colour(visual: Element, path: str) -> tuple[float, ...] | None:
    """Return the diffuse (else ambient) colour of a visual's material, None if it has none or is white."""
    text = visual.findtext("material/diffuse") or visual.findtext("material/ambient")
    words = (text or "").split()
    if len(words) not in (3, 4):
        return None
    colour = tuple(min(max(number_of(word, path), 0.0), 1.0) for word in words[:3])
    return None if min(colour) >= 1.0 else colour
