"""Convert a vehicle's SDF model to a URDF robot in memory, so that one importer serves both formats.

The root is the hull, on which the hydrodynamics act (see `sim.vehicle.urdf.hull`): its frame becomes the vehicle's.
Other links are joined to it, or to the moving link that carries them, at their positions with all joints at zero.
"""

import os
from collections.abc import Iterable

from hil.common.errors import ConfigError
from sim.sdf.files import SdfFiles
from sim.sdf.model import Joint, Link, Model, models_of
from sim.vehicle.urdf.importer import tree_of
from sim.vehicle.urdf.pose import Pose
from sim.vehicle.urdf.sdf_pose import own_pose
from sim.vehicle.urdf.text import Element, plain, read_xml

_SIZES = {"box": ("size",), "cylinder": ("radius", "length"), "sphere": ("radius",), "capsule": ("radius", "length")}
_INERTIA = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def as_urdf(path: str, notes: list[str], name: str | None = None, text: bytes | None = None) -> Element:
    """Return the `<robot>` of the model in the SDF file at `path`; in a world, that of the model `name`.

    `text` is read in place of the file. `notes` gets what cannot be converted. Raises ConfigError.
    """
    root = read_xml(path, text, "sdf")
    files, folder = SdfFiles(path), os.path.dirname(os.path.abspath(path))
    world = root.find("world")
    models = models_of(world if world is not None else root, folder, files, notes, root.get("version", "1.12"))
    model = _choose_model(models, name, path, notes)
    robot = _robot(model, files, notes)
    if world is not None:
        robot.extend(world.findall("plugin"))
    return robot


def _choose_model(models: list[Model], name: str | None, path: str, notes: list[str]) -> Model:
    """Return the model `name`, or the only model that is a vehicle. Raises ConfigError."""
    if name is not None:
        candidates = [model for model in models if model.name == name]
    else:
        driven = [model for model in models if any(_is_of_vehicle(plugin) for plugin in model.plugins)]
        candidates = driven or [model for model in models if not model.is_static]
        candidates = candidates if len(models) > 1 else models
    if len(candidates) != 1:
        names = ", ".join(model.name for model in (candidates or models)) or "none"
        which = f"give --model NAME, one of: {names}" if models else "there is no model in it"
        raise ConfigError(_with_notes(f"{path}: {len(candidates)} vehicles in it that could be meant; {which}", notes))
    if not candidates[0].links:
        raise ConfigError(_with_notes(f"{path}: the model {candidates[0].name!r} has no links", notes))
    return candidates[0]


def _with_notes(problem: str, notes: list[str]) -> str:
    """Return the text of a problem with the first note on what was left out, which may be its cause."""
    return ". ".join([problem, *(note.rstrip(".") for note in notes[:1])])


def _is_of_vehicle(plugin: Element) -> bool:
    text = (plugin.get("filename", "") + plugin.get("name", "")).lower()
    return any(word in text for word in ("thruster", "hydrodynamic", "motormodel", "underwater_object"))


def _robot(model: Model, files: SdfFiles, notes: list[str]) -> Element:
    robot = Element("robot", name=model.name)
    bare = [name for name, link in model.links.items() if link.element.find("inertial") is None]
    if bare:
        notes.append(
            f"No mass is given for {', '.join(map(plain, bare))}: none is taken, where Gazebo takes 1 kg each."
        )
    for name, link in model.links.items():
        robot.append(_link(name, link, files, notes))
        for sensor in link.element.findall("sensor"):
            holder = Element("gazebo", reference=name)
            holder.append(sensor)
            robot.append(holder)
    for plugin in model.plugins:
        holder = Element("gazebo")
        holder.append(plugin)
        robot.append(holder)
    joints = {joint.child: (name, joint) for name, joint in model.joints.items() if joint.parent != "world"}
    parents = {child: (joint.parent, joint.kind == "fixed") for child, (_, joint) in joints.items()}
    usual = model.canonical if model.canonical in model.links else next(iter(model.links))
    tree = tree_of(robot, files.path)._replace(parents=parents)
    base = tree.hull(usual)
    for name, link in model.links.items():
        if name != base:
            parent, is_fixed = parents.get(name, (base, True))
            above = parent if is_fixed and not tree.is_fixed_to(name, base) else base  # what an arm carries moves too
            pose = model.links[above].pose.inverse().then(link.pose)
            robot.append(_joint(name, pose, link, joints.get(name), above))
    own = joints.get(base)
    if own and own[1].axis is not None and own[1].kind != "fixed":  # relative to the base, the other link turns
        notes.append(f"The joint {own[0]!r} holds the link {base!r}, on which the water acts: taken as fixed.")
    return robot


def _link(name: str, link: Link, files: SdfFiles, notes: list[str]) -> Element:
    element = Element("link", name=name)
    inertial = link.element.find("inertial")
    if inertial is not None:
        element.append(_inertial(inertial, files.path))
    for kind in ("visual", "collision"):
        for shape in link.element.findall(kind):
            geometry = shape.find("geometry")
            if geometry is not None and (converted := _geometry(geometry, link.folder, files, notes, name)) is not None:
                placed = Element(kind)
                placed.append(_origin(own_pose(shape, files.path)))
                placed.append(converted)
                element.append(placed)
    return element


def _inertial(inertial: Element, path: str) -> Element:
    element = Element("inertial")
    element.append(_origin(own_pose(inertial, path)))
    element.append(Element("mass", value=(inertial.findtext("mass") or "1").strip()))  # SDF's default
    tensor = inertial.find("inertia")
    usual = {"ixx": "1", "iyy": "1", "izz": "1"}
    texts = {key: (tensor.findtext(key) if tensor is not None else None) or usual.get(key, "0") for key in _INERTIA}
    element.append(Element("inertia", {key: text.strip() for key, text in texts.items()}))
    element.extend(inertial.findall("fluid_added_mass"))
    return element


def _geometry(geometry: Element, folder: str, files: SdfFiles, notes: list[str], link: str) -> Element | None:
    element = Element("geometry")
    for shape in geometry:
        if shape.tag == "mesh":
            uri = (shape.findtext("uri") or "").strip()
            file = files.find(uri, folder)
            if file is None:
                notes.append(f"Left out: the mesh {uri[:100]!r} of the link {link!r}, which is not near the file.")
                return None
            scale = (shape.findtext("scale") or "1 1 1").strip()
            element.append(Element("mesh", filename=os.path.abspath(file), scale=scale))
        elif shape.tag in _SIZES:
            element.append(Element(shape.tag, {key: (shape.findtext(key) or "1").strip() for key in _SIZES[shape.tag]}))
        elif shape.tag == "ellipsoid":
            element.append(Element("ellipsoid", radii=(shape.findtext("radii") or "1 1 1").strip()))
        elif shape.tag != "empty":
            notes.append(f"Left out: the shape <{shape.tag}> of the link {link!r}.")
            return None
    return element if len(element) else None


def _joint(link: str, pose: Pose, of: Link, named_joint: tuple[str, Joint] | None, parent: str) -> Element:
    """Return the joint of a link at `pose` relative to its parent; its axis is in the axes of the link, as in URDF."""
    name, joint = named_joint or (f"{link}_joint", None)
    kind = joint.kind if joint is not None else "fixed"
    element = Element("joint", name=name, type=kind)
    element.append(Element("parent", link=parent))
    element.append(Element("child", link=link))
    element.append(_origin(pose))
    if joint is not None and joint.axis is not None:
        element.append(Element("axis", xyz=_words(of.pose.inverse().rotate(joint.axis))))
        limit = joint.element.find("axis/limit")
        if limit is not None and kind == "revolute":
            texts = {key: (limit.findtext(key) or "").strip() for key in ("lower", "upper")}
            element.append(Element("limit", {key: text for key, text in texts.items() if text}))
    return element


def _origin(pose: Pose) -> Element:
    return Element("origin", xyz=_words(pose.position), rpy=_words(pose.angles()))


def _words(numbers: Iterable[float]) -> str:
    return " ".join(repr(round(x, 12) + 0.0) for x in numbers)
