"""Read a model of SDF with all included and nested models: links, joints and plugins in one frame."""

from typing import NamedTuple

from hil.common.errors import ConfigError
from sim.sdf.files import SdfFiles
from sim.sdf.poses import MODEL, relative_to, resolve
from sim.vehicle.urdf.pose import Pose
from sim.vehicle.urdf.sdf_pose import own_pose
from sim.vehicle.urdf.text import Element, attribute, numbers_of

_MAX_DEPTH = 8  # of nested models
_SEPARATOR = "::"
_NAMES = ("link_name", "linkName", "joint_name", "jointName", "control_joint_name")  # tags of plugins that name a part


class Link(NamedTuple):
    """A link: its pose in the model's frame, its element, and the folder of its file."""

    pose: Pose
    element: Element
    folder: str


class Joint(NamedTuple):
    """A joint of two links; `axis` is a unit vector in the model's frame, None if it has no axis."""

    kind: str
    parent: str
    child: str
    axis: tuple[float, ...] | None
    element: Element


class Model(NamedTuple):
    """A model in its own frame; `pose` is relative to the world or the outer model.

    Names of links and joints in nested models are `MODEL::NAME`; `nested` has the poses of those models as `MODEL::`.
    `scale` are factors for its sizes along x, y and z.
    """

    name: str
    pose: Pose
    is_static: bool
    links: dict[str, Link]
    joints: dict[str, Joint]
    plugins: list[Element]
    canonical: str
    nested: dict[str, Pose]
    scale: tuple[float, ...] = (1.0, 1.0, 1.0)


class _Scope:
    """The frames and nested models of one model element, as far as it has been read."""

    def __init__(self) -> None:
        self.frames: dict[str, tuple[str, Pose]] = {}
        self.nested: list[tuple[str, Model]] = []  # the prefix of a nested model's names, and the model


def read_model(
    element: Element, folder: str, files: SdfFiles, notes: list[str], depth: int = 0, version: str = "1.12"
) -> Model:
    """Return the model of a `<model>` in a file of `folder`; `notes` gets what cannot be read. Raises ConfigError."""
    path = files.path
    if depth > _MAX_DEPTH:
        raise ConfigError(f"{path}: models in each other, more than {_MAX_DEPTH} deep")
    scope = _Scope()
    for child in element:
        _read_child(child, scope, folder, files, notes, depth, version)
    links: dict[str, Link] = {}
    joints: dict[str, Joint] = {}
    plugins: list[Element] = []
    nested: dict[str, Pose] = {}
    for prefix, inner in scope.nested:
        base = resolve(f"{prefix or inner.name + _SEPARATOR}{MODEL}", scope.frames, path)
        links |= {prefix + name: link._replace(pose=base.then(link.pose)) for name, link in inner.links.items()}
        joints |= {prefix + name: _moved(joint, base, prefix) for name, joint in inner.joints.items()}
        plugins += [_renamed(plugin, prefix, inner) for plugin in inner.plugins]
        nested |= {prefix + name: base.then(pose) for name, pose in {"": Pose(), **inner.nested}.items()}
    for child in element.findall("link"):
        name = child.get("name", "")
        pose = resolve(name, scope.frames, path)
        _make_poses_local(child, name, pose, scope, path)
        links[name] = Link(pose, child, folder)
    for child in element.findall("joint"):
        joints[child.get("name", "")] = _joint(child, scope, path, version)
    plugins += element.findall("plugin")
    is_static = (element.findtext("static") or "0").strip().lower() in ("1", "true")
    first = next(iter(links), "")
    return Model(
        element.get("name", "model"), own_pose(element, path), is_static, links, joints, plugins,
        element.get("canonical_link") or first, nested,
    )  # fmt: skip


def models_of(parent: Element, folder: str, files: SdfFiles, notes: list[str], version: str) -> list[Model]:
    """Return the top-level models of a world or a file, then the included ones. Raises ConfigError.

    In a saved world the models are those of its `<state>`: some were inserted, deleted, scaled or moved.
    """
    elements = [*parent.findall("model"), *parent.findall("state/insertions/model")]
    own = [read_model(child, folder, files, notes, 0, version) for child in elements]
    others = [_included(child, folder, files, notes) for child in parent.findall("include")]
    deleted = {(name.text or "").strip() for name in parent.findall("state/deletions/name")}
    models = [model for model in (*own, *others) if model is not None and model.name not in deleted]
    saved = {state.get("name"): state for state in parent.findall("state/model")}
    return [_placed(model, saved[model.name], files.path) if model.name in saved else model for model in models]


def _placed(model: Model, state: Element, path: str) -> Model:
    """Return a model with the poses of its `<state>`.

    All of them are in the world, those of links too, as Gazebo Classic writes them: of a model at x = 1.22 with a link
    0.1 m above it, the link has (1.22, -1.11, 0.1). The descriptions of SDF 1.2 to 1.4, "relative to the model", do
    not hold for any saved world.
    """
    in_world: dict[str, Pose] = {}
    states = [("", state)]
    for prefix, own in states:
        parts = [(prefix, own), *((prefix + part.get("name", ""), part) for part in own.findall("link"))]
        in_world |= {name: own_pose(part, path) for name, part in parts if part.find("pose") is not None}
        states += [(f"{prefix}{part.get('name')}{_SEPARATOR}", part) for part in own.findall("model")]
    placed = in_world.get("", model.pose)
    nested = {"": Pose(), **model.nested}
    links, joints = dict(model.links), dict(model.joints)
    for name, link in links.items():
        around = [prefix for prefix in nested if prefix in in_world and name.startswith(prefix)]
        group = max(around, key=len, default="")
        moved = in_world.get(group, placed).then(nested[group].inverse()).then(link.pose)
        links[name] = link._replace(pose=placed.inverse().then(in_world.get(name, moved)))
    for name, joint in joints.items():
        if joint.axis and joint.child in links:
            turned = model.links[joint.child].pose.inverse().rotate(joint.axis)
            joints[name] = joint._replace(axis=links[joint.child].pose.rotate(turned))
    scale = numbers_of(state.findtext("scale") or "1 1 1", path, 3)
    return model._replace(pose=placed, links=links, joints=joints, scale=tuple(scale))


def _included(include: Element, folder: str, files: SdfFiles, notes: list[str], depth: int = 0) -> Model | None:
    """Return the model of an `<include>`, with the name, pose and plugins of the include; None if it is not found."""
    uri = (include.findtext("uri") or "").strip()
    read = files.read_model(uri, folder) if uri else None
    if read is None:
        shown, word = uri[:100] or "without a <uri>", "there" if uri.startswith("http") else "near the file"
        note = (
            f"Left out: {shown!r}, included by a file in {folder}, which is not {word}: download it, and name the "
            "folder that it is in by GZ_SIM_RESOURCE_PATH."
        )
        notes += [note] if note not in notes else []
        files.missing.append(shown)
        return None
    root, own_folder = read
    element = root.find("model")
    if element is None:
        if root.find("light") is None:
            notes.append(f"Left out: the included {uri[:100]!r}, in which there is no <model>.")
        return None
    for key in ("name", "static"):
        if text := (include.findtext(key) or "").strip():
            if key == "name":
                element.set("name", text)
            else:
                _put(element, key, text)
    for plugin in include.findall("plugin"):
        element.append(plugin)
    if (pose := include.find("pose")) is not None:
        if (old := element.find("pose")) is not None:
            element.remove(old)
        element.append(pose)
    model = read_model(element, own_folder, files, notes, depth + 1, root.get("version", "1.12"))
    if placement := (include.findtext("placement_frame") or element.get("placement_frame")):
        frame = model.links[placement].pose if placement in model.links else Pose()
        model = model._replace(pose=model.pose.then(frame.inverse()))
    return model


def _read_child(
    child: Element, scope: _Scope, folder: str, files: SdfFiles, notes: list[str], depth: int, version: str
) -> None:
    """Read the frame of a child element of a model into `scope`; read a nested or included model completely."""
    name, path = child.get("name", ""), files.path
    if child.tag == "link":
        scope.frames[name] = relative_to(child, MODEL), own_pose(child, path)
    elif child.tag == "joint":
        scope.frames.setdefault(name, (relative_to(child, _link_name(child, "child")), own_pose(child, path)))
    elif child.tag == "frame":
        scope.frames[name] = relative_to(child, child.get("attached_to") or MODEL), own_pose(child, path)
    elif child.tag == "include":
        inner = _included(child, folder, files, notes, depth)
        if inner is not None:
            is_merged = (child.get("merge") or "").lower() in ("1", "true")
            _nest(inner, "" if is_merged else inner.name + _SEPARATOR, relative_to(child, MODEL), scope)
    elif child.tag == "model":
        model = read_model(child, folder, files, notes, depth + 1, version)
        _nest(model, model.name + _SEPARATOR, relative_to(child, MODEL), scope)


def _nest(model: Model, prefix: str, frame: str, scope: _Scope) -> None:
    base = f"{prefix or model.name + _SEPARATOR}{MODEL}"
    scope.frames[base] = scope.frames[model.name] = frame, model.pose
    for name, link in model.links.items():
        scope.frames[prefix + name] = base, link.pose
    scope.nested.append((prefix, model))


def _make_poses_local(link: Element, name: str, pose: Pose, scope: _Scope, path: str) -> None:
    """Convert poses in a link that are relative to other frames to poses relative to the link."""
    for child in link:
        frame = relative_to(child, name)
        pose_element = child.find("pose")
        if frame != name and pose_element is not None:
            within = pose.inverse().then(resolve(frame, scope.frames, path)).then(own_pose(child, path))
            written = " ".join(repr(x) for x in (*within.position, *within.angles()))
            child.remove(pose_element)
            _put(child, "pose", written)


def _joint(joint: Element, scope: _Scope, path: str, version: str) -> Joint:
    parent, child = _link_name(joint, "parent"), _link_name(joint, "child")
    axis = joint.find("axis")
    direction = None
    if axis is not None:
        xyz = axis.find("xyz")
        text = (xyz.text if xyz is not None else None) or "0 0 1"
        frame = (xyz.get("expressed_in", "") if xyz is not None else "") or joint.get("name", "")
        is_old = [int(part) for part in version.split(".") if part.isdecimal()] < [1, 5]  # in the model's axes then
        if is_old or (axis.findtext("use_parent_model_frame") or "0").strip() in ("1", "true"):
            frame = MODEL
        known = frame in scope.frames and all(part in (*scope.frames, "world", MODEL) for part in (parent, child))
        turned = resolve(frame, scope.frames, path) if known else Pose()
        direction = turned.rotate(numbers_of(text, path, 3))
    return Joint(joint.get("type", ""), parent, child, direction, joint)


def _link_name(joint: Element, side: str) -> str:
    """Return the link at one side of a joint, in SDF's notation or, in old files, in URDF's."""
    return (joint.findtext(side) or "").strip() or attribute(joint, side, "link")


def _moved(joint: Joint, base: Pose, prefix: str) -> Joint:
    axis = base.rotate(joint.axis) if joint.axis else None
    parent = joint.parent if joint.parent == "world" else prefix + joint.parent
    return joint._replace(parent=parent, child=prefix + joint.child, axis=axis)


def _renamed(plugin: Element, prefix: str, inner: Model) -> Element:
    """Return a plugin of a nested model with the names that links and joints have in the outer model."""
    for name in _NAMES:
        for part in plugin.findall(name):
            text = (part.text or "").strip()
            if text in inner.links or text in inner.joints:
                part.text = prefix + text
    return plugin


def _put(element: Element, tag: str, text: str) -> None:
    child = element.find(tag)
    if child is None:
        child = Element(tag)
        element.append(child)
    child.text = text
