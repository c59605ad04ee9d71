"""Read the hydrodynamics in the tags of simulators: volume, box, added mass and damping."""

import re
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from math import log, pi, sqrt
from typing import Any

from hil.common.errors import ConfigError
from sim.matrices import Matrix, square, total
from sim.vehicle.urdf.hull import MATRICES
from sim.vehicle.urdf.pose import Pose
from sim.vehicle.urdf.text import Element, child_text, number_of, numbers_of, plain, to_frd

Box = Callable[[], list[float] | None]  # returns the sides (m) of the box around a link, None if it has no shape
_ROWS, _COLUMNS, _ADDED = "xyzkmn", "UVWPQR", "xyzpqr"
_SQUARE = re.compile(f"([{_ROWS}])([{_COLUMNS}])(abs)?([{_COLUMNS}])")  # a quadratic term's tag
_DENSITY = "1028"  # kg/m³: default of uuv_simulator
_MODELS = ("fossen", "sphere", "cylinder", "spheroid", "ellipsoid", "box")
# Drag coefficients of a cylinder, axial and transverse, by length over diameter, as in uuv_simulator's
# HydrodynamicModel.cc.
_END_DRAG = ((1.0, 0.91), (2.0, 0.85), (4.0, 0.87), (7.0, 0.99))
_SIDE_DRAG = ((1.0, 0.63), (2.0, 0.68), (5.0, 0.74), (10.0, 0.82))
_SIDE_DRAG_LONG = 0.98
_SPHERE_DRAG = 0.5
_MAX_SIZE = 100.0  # m, of a shape


def water_elements(robot: Element) -> Iterator[tuple[str, int, Element]]:
    """Yield each element with hydrodynamics: its link ("" if it names none), its place in `_READERS`, the element."""
    for holder in (*robot.findall("link"), *robot.findall("gazebo")):
        added = holder.find("inertial/fluid_added_mass")
        if added is not None:
            yield holder.get("name") or holder.get("reference") or "", 2, added
    for element in robot.iter():
        file = element.get("filename", "").lower()
        if element.tag == "hydrodynamics" or "hydrodynamics" in file:
            yield child_text(element, "link_name") or "", 1, element
        elif element.tag == "link" and element.find("hydrodynamic_model") is not None:
            yield element.get("name", ""), 3, element
        elif "libbuoyancyplugin" in file:
            yield from ((link.get("name", ""), 0, link) for link in element.findall("link"))


def read_water(
    robot: Element, hull: str, box_of: Callable[[str], list[float] | None], path: str, notes: list[str]
) -> dict[str, dict[str, Any]]:
    """Return the keys of each link that the tags give, in its axes (FLU) about its origin, and `neutral`.

    Tags without a link, or of one that is not there, are the hull's. What several tags of one simulator give for a link
    is added up; of different simulators, the last one in `_READERS` counts. `box_of` returns the box around a link.
    `notes` gets what cannot be imported.
    """
    links = {link.get("name", "") for link in robot.findall("link")}
    found: dict[tuple[str, int], dict[str, Any]] = {}
    for name, kind, element in water_elements(robot):
        if name and name not in links:
            notes.append(f"The water of {plain(name)[:80]!r}, which is not there, is that of {plain(hull)!r}.")
        link = name if name in links else hull
        keys, earlier = _READERS[kind](element, partial(box_of, link), path, notes), found.get((link, kind), {})
        for key in keys.keys() & earlier.keys() & set(MATRICES):
            keys[key] = total(earlier[key], keys[key])
        found[link, kind] = earlier | keys
    waters: dict[str, dict[str, Any]] = {}
    for (link, _), keys in sorted(found.items(), key=lambda item: item[0]):
        waters[link] = waters.get(link, {}) | keys
    return waters


def read_munk_share(robot: Element, notes: list[str]) -> dict[str, Any]:
    """Return a `munk_share` of 0 if the model switches the Coriolis terms of its added mass off; else {}."""
    off = {"disable_coriolis": ("1", "true"), "enable_coriolis": ("0", "false")}
    if not any((each.findtext(tag) or "").strip() in words for each in robot.iter() for tag, words in off.items()):
        return {}
    notes.append("The model switches its Coriolis terms off: munk_share is 0.")
    return {"munk_share": [0.0] * 3}


def read_buoyancy_engine(robot: Element, poses: Mapping[str, Pose], path: str) -> dict[str, Any]:
    """Return the `buoyancy_engine` of Gazebo's plugin of that name, with the plugin's defaults; {} if there is none."""
    for plugin in robot.iter("plugin"):
        link = child_text(plugin, "link_name")
        if link is not None and link in poses and "buoyancy-engine" in plugin.get("filename", "").lower():
            texts = {
                "min_volume": ("min_volume", "0.00003"), "neutral_volume": ("neutral_volume", "0.0003"),
                "max_volume": ("max_volume", "0.00099"), "rate": ("max_inflation_rate", "0.000003"),
            }  # fmt: skip
            numbers = {key: number_of(child_text(plugin, tag) or usual, path) for key, (tag, usual) in texts.items()}
            return {"buoyancy_engine": {"position": to_frd(poses[link].position), **numbers}}
    return {}


def _fluid_added_mass(added: Element, box: Box, path: str, notes: list[str]) -> dict[str, Any]:
    """Return added mass of SDFormat 1.10: the upper triangle as <xx> <xy> ... <rr>, positive, in the link's frame."""

    def entry(i: int, j: int) -> float:
        return number_of(added.findtext(_ADDED[min(i, j)] + _ADDED[max(i, j)]) or "0", path)

    return {"added_mass": [[entry(i, j) for j in range(6)] for i in range(6)]}


def _gazebo_water(element: Element, box: Box, path: str, notes: list[str]) -> dict[str, Any]:
    """Return the keys for Gazebo's stability derivatives; a key without any derivative is left out.

    The derivatives have Fossen's names and are negative where they damp. `xUabsV` multiplies U |V|. A vehicle's file
    has terms with the square of one speed, and terms with |U|.
    """
    keys: dict[str, Any] = {}
    for key, form in (("added_mass", "{0}Dot{1}"), ("linear_damping", "{0}{1}")):
        texts = [[element.findtext(form.format(row, column)) for column in _COLUMNS] for row in _ROWS]
        if any(text is not None for row in texts for text in row):
            keys[key] = [[-number_of(text or "0", path) for text in row] for row in texts]
    if "added_mass" in keys and (element.findtext("disable_added_mass") or "").strip() in ("1", "true"):
        del keys["added_mass"]
    squares, by_surge = square([0.0] * 6, 6), square([0.0] * 6, 6)
    terms = [(child, match) for child in element if (match := _SQUARE.fullmatch(child.tag))]
    lost = []
    for child, match in terms:
        i, value = _ROWS.index(match[1]), -number_of(child.text or "0", path)
        j, k = map(_COLUMNS.index, match.group(2, 4))
        if j == k:
            squares[i][j] += value
        elif k == 0 and i != 0:
            by_surge[i][j] += value
        elif value:
            lost.append(child.tag)
    if terms:
        keys["quadratic_damping"] = squares
    if any(x for row in by_surge for x in row):
        keys["forward_speed_damping"] = by_surge
    if lost:
        notes.append(f"Left out: the damping {', '.join(lost)}, by the product of two different speeds.")
    if not all(match[3] for _, match in terms):
        notes.append("Damping such as xUU, which newer Gazebo takes without the sign of the speed, is read as xUabsU.")
    return keys


def _classic_buoyancy(link: Element, box: Box, path: str, notes: list[str]) -> dict[str, Any]:
    """Return volume and centre of buoyancy of a link in Gazebo classic's buoyancy plugin."""
    return _numbers(link, {"volume": ("volume", 1), "center_of_buoyancy": ("center_of_volume", 3)}, path)


def _numbers(element: Element, tags: Mapping[str, tuple[str, int]], path: str) -> dict[str, Any]:
    """Return a number, or a list of several, for each key whose tag is there."""
    keys: dict[str, Any] = {}
    for key, (tag, count) in tags.items():
        if (text := element.findtext(tag)) is not None:
            numbers = numbers_of(text, path, count)
            keys[key] = numbers if count > 1 else numbers[0]
    return keys


def _uuv_water(link: Element, box: Box, path: str, notes: list[str]) -> dict[str, Any]:
    """Return the water keys of uuv_simulator: added mass positive, damping negative, each as 6 or 36 numbers."""
    model = link.find("hydrodynamic_model")
    assert model is not None, "water_elements looks for it"
    keys = _numbers(link, {"volume": ("volume", 1), "center_of_buoyancy": ("center_of_buoyancy", 3)}, path)
    for key, tag, sign in (
        ("added_mass", "added_mass", 1.0), ("linear_damping", "linear_damping", -1.0),
        ("quadratic_damping", "quadratic_damping", -1.0),
        ("forward_speed_damping", "linear_damping_forward_speed", -1.0),
    ):  # fmt: skip
        text = model.findtext(tag)
        if text is not None:
            keys[key] = square([sign * number for number in numbers_of(text, path, 6, 36)], 6)
    if not any(x for row in keys.get("forward_speed_damping", ()) for x in row):
        keys.pop("forward_speed_damping", None)
    sides = [link.findtext(f"box/{side}") for side in ("length", "width", "height")]
    if None not in sides:
        keys["dimensions"] = [number_of(text or "", path) for text in sides]
    for key, matrix in _of_shape(link, model, lambda: keys.get("dimensions") or box(), path, notes).items():
        keys[key] = total(keys[key], matrix) if key in keys else matrix
    keys["neutral"] = (link.findtext("neutrally_buoyant") or "0").strip() in ("1", "true")
    return keys


# By place in the order of priority. Each returns keys of one element of a link.
_READERS = (_classic_buoyancy, _gazebo_water, _fluid_added_mass, _uuv_water)


def _of_shape(link: Element, model: Element, box: Box, path: str, notes: list[str]) -> dict[str, Matrix]:
    """Return added mass and drag of a `<hydrodynamic_model>` with a shape's type, by uuv_simulator's formulas."""
    kind = (model.findtext("type") or "fossen").strip().lower()
    if kind not in _MODELS:
        raise ConfigError(f"{path}: hydrodynamic_model: no type {plain(kind)[:40]!r}; there are: {', '.join(_MODELS)}")
    if kind == "fossen":
        return {}
    plugin = (model.findtext("fluid_density") or link.findtext("fluid_density") or _DENSITY).strip()
    density, name = number_of(plugin, path), plain(link.get("name", ""))
    sizes = {key: _size(model, key, kind, box, path) for key in _NEEDED[kind]}
    derived = [f"{key} {sizes[key]:g} m" for key in sizes if model.find(key) is None]
    if derived:
        notes.append(
            f"The {kind} of {name} fills the box around it: {', '.join(derived)}. (uuv_simulator takes a whole side of "
            "the box for a radius.)"
        )
    if kind == "sphere":
        added, drag = _sphere(density, **sizes)
    elif kind == "cylinder":
        sides = box() if derived and model.find("axis") is None else None
        usual = "ijk"[sides.index(max(sides))] if sides else "i"
        added, drag = _cylinder(density, (model.findtext("axis") or usual).strip(), path, **sizes)
        notes.append("The cylinder's added mass along its axis is uuv_simulator's rho pi r², which lacks a length.")
    elif kind == "box":
        added, drag = _box(density, number_of(model.findtext("cd") or "1", path), **sizes)
        notes.append("The box has no added mass, as in uuv_simulator: --add one.")
    else:
        added, drag = _spheroid(density, **sizes), [0.0] * 6
        notes.append("The spheroid's added mass is Lamb's (Fossen 2021, 8.1); it has no drag but what the file gives.")
    return {
        "added_mass": square(added, 6), "quadratic_damping": square(drag, 6), "linear_damping": square([0.0] * 6, 6),
    }  # fmt: skip


_NEEDED = {
    "sphere": ("radius",), "cylinder": ("radius", "length"), "spheroid": ("radius", "length"),
    "ellipsoid": ("radius", "length"), "box": ("length", "width", "height"),
}  # fmt: skip


def _size(model: Element, key: str, kind: str, box: Box, path: str) -> float:
    """Return a size (m) of a shape, from the box around the link if the file does not say it."""
    text, sides = model.findtext(key), None if model.find(key) is not None else box()
    if text is None and sides is None:
        raise ConfigError(f"{path}: hydrodynamic_model of type {kind}: does not say <{key}>: write it there")
    if sides is None:
        size = number_of(text or "", path)
    elif kind == "box":
        size = sides[_NEEDED[kind].index(key)]
    else:  # of a spheroid, radius and length are both half of what they are called
        half = key == "radius" or kind != "cylinder"
        size = (min(sides) if key == "radius" else max(sides)) * (0.5 if half else 1.0)
    if not 0.0 < size <= _MAX_SIZE:
        raise ConfigError(f"{path}: hydrodynamic_model: <{key}> must be above 0, at most {_MAX_SIZE:g}, found {size:g}")
    return size


def _sphere(density: float, radius: float) -> tuple[list[float], list[float]]:
    added, drag = 2.0 / 3.0 * density * pi * radius**3, 0.5 * density * _SPHERE_DRAG * pi * radius**2
    return [added] * 3 + [0.0] * 3, [drag] * 3 + [0.0] * 3


def _cylinder(density: float, axis: str, path: str, radius: float, length: float) -> tuple[list[float], list[float]]:
    if axis not in ("i", "j", "k"):
        raise ConfigError(f"{path}: hydrodynamic_model: axis {plain(axis)[:20]!r} is none of i, j, k")
    ratio, along = length / (2.0 * radius), "ijk".index(axis)
    end = next((drag for most, drag in _END_DRAG if ratio <= most), 0.0)  # uuv_simulator gives longer ones none
    side = next((drag for most, drag in _SIDE_DRAG if ratio <= most), _SIDE_DRAG_LONG)
    disc = density * pi * radius**2
    added, drag = [disc * length] * 3, [0.5 * side * density * radius * length] * 3
    turning = [disc * length**3 / 12.0] * 3
    added[along], drag[along], turning[along] = disc, 0.5 * end * disc, 0.0
    return added + turning, drag + [0.0] * 3


def _spheroid(density: float, radius: float, length: float) -> list[float]:
    """Return Lamb's added mass of a prolate spheroid along x with semi-axes `length` and `radius` (m)."""
    if length <= radius:
        return [2.0 / 3.0 * density * pi * radius**2 * length] * 3 + [0.0] * 3
    mass, e = 4.0 / 3.0 * pi * density * length * radius**2, sqrt(1.0 - (radius / length) ** 2)
    logarithm = log((1.0 + e) / (1.0 - e))
    alpha = 2.0 * (1.0 - e * e) / e**3 * (0.5 * logarithm - e)
    beta = 1.0 / e**2 - (1.0 - e * e) / (2.0 * e**3) * logarithm
    less, more = radius**2 - length**2, radius**2 + length**2
    turning = -0.2 * mass * less**2 * (alpha - beta) / (2.0 * less - more * (alpha - beta))
    ahead, across = mass * alpha / (2.0 - alpha), mass * beta / (2.0 - beta)
    return [ahead, across, across, 0.0, abs(turning), abs(turning)]


def _box(density: float, drag: float, length: float, width: float, height: float) -> tuple[list[float], list[float]]:
    faces = (width * height, length * height, length * width)
    return [0.0] * 6, [0.5 * drag * density * face for face in faces] + [0.0] * 3
