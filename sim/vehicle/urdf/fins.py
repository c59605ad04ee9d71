"""Read the fins of a model from the plugins of simulators, and convert their lift to that of `sim.vehicle.fins`.

uuv_simulator's fins turn about their link's z axis and point along its x axis; Gazebo's have a forward axis. A surface
that no joint turns is reported and left out, because a vehicle's file cannot describe it.
"""

from collections.abc import Mapping
from math import hypot, pi
from typing import Any

from sim.matrices import cross_matrix
from sim.vehicle.fins import Fin
from sim.vehicle.urdf.pose import Pose
from sim.vehicle.urdf.text import Element, attribute, child_text, listed, number_of, numbers_of, plain, to_frd, unscoped
from sim.vehicle.urdf.thrusters import target

# uuv_simulator's libuuv_fin_ros_plugin.so, Gazebo's libLiftDragPlugin.so, gz-sim's gz-sim-lift-drag-system.
_FILES = ("uuv_fin", "fin_ros_plugin", "liftdrag", "lift-drag", "lift_drag")
OWN = "uuv_hil"  # the tag whose attributes are our keys for which the plugins have no tags
_CHORD, _AXIS = "1 0 0", "1 0 0"  # defaults for the chord of a fin and the axis of a joint
_DENSITY = 1000.0  # kg/m³, for constants that include it
_SLOPE = 2.6  # 1/rad: that of a fin of aspect ratio 2 (Helmbold), if only its product with the area is known
_DEFAULT_DEFLECTION = 0.5236  # rad: for a joint without limits
_PARALLEL = 1e-9  # length of the cross product below which axis and chord count as parallel


def read_fins(
    robot: Element, poses: Mapping[str, Pose], path: str, given_names: set[str], notes: list[str]
) -> list[dict[str, Any]]:
    """Return the fins of the model, except those whose names are in `given_names`; `notes` gets what is left out.

    A fin that two plugins name is read once. Raises ConfigError for text that should be a number.
    """
    joints = {target(joint, "child"): joint for joint in robot.findall("joint")}
    reported, fins = set(given_names), []
    for plugin in robot.iter("plugin"):
        file = plugin.get("filename", "").lower()
        link = child_text(plugin, "link_name", "linkName")
        if not any(part in file for part in _FILES) or not link:
            continue
        name = unscoped(link)
        if name in reported:
            continue
        reported.add(name)
        fin, lacks = _fin(plugin, joints.get(link), poses.get(link), path, notes)
        if fin is None:
            notes.append(_left_out(name, plugin, poses.get(link), lacks))
        else:
            fins.append({"name": name.removesuffix("_link") if plugin.find(OWN) is not None else name} | fin)
    return fins


def _fin(
    plugin: Element, joint: Element | None, pose: Pose | None, path: str, notes: list[str]
) -> tuple[dict[str, Any] | None, str]:
    """Return the keys of a fin, or None and the reason why it cannot be imported."""
    if pose is None:
        return None, "no such link"
    if joint is None or joint.get("type") == "fixed":
        return None, "no joint turns it"
    keys = _coefficients(plugin, path)
    if keys is None:
        return None, "its lift is not one of uuv_simulator's or Gazebo's"
    axis = numbers_of(attribute(joint, "axis", "xyz", _AXIS), path, 3)
    chord = numbers_of(child_text(plugin, "forward") or _CHORD, path, 3)
    centre = numbers_of(child_text(plugin, "cp") or "0 0 0", path, 3)
    if hypot(*Pose(cross_matrix(axis)).rotate(chord)) < _PARALLEL:
        return None, "its joint turns it about its chord"
    limits = [abs(number_of(attribute(joint, "limit", side) or "1e16", path)) for side in ("lower", "upper")]
    max_deflection = min(limits)
    if max_deflection > pi / 2.0:
        notes.append(
            f"The joint {joint.get('name', '')!r} of a fin has no limits: taken for {_DEFAULT_DEFLECTION:g} rad."
        )
        max_deflection = _DEFAULT_DEFLECTION
    if number_of(child_text(plugin, "a0", "liftdrag/a0") or "0", path):
        notes.append("Left out: the angle a0 at which a fin has no lift.")
    lag, own = child_text(plugin, "dynamics/timeConstant"), plugin.find(OWN)
    fin: dict[str, Any] = {
        "position": to_frd(pose.transform(centre)), "axis": to_frd(pose.rotate(axis)),
        "chord": to_frd(pose.rotate(chord)),
        "max_deflection": max_deflection, **keys, **({"time_constant": abs(number_of(lag, path))} if lag else {}),
    }  # fmt: skip
    return (fin if own is None else _as_ours(fin, own, path)), ""


def _as_ours(fin: dict[str, Any], own: Element, path: str) -> dict[str, Any]:
    """Return the keys of a fin with those that our own URDF gives; with an aspect ratio, without those it implies."""
    given = {key: number_of(text, path) for key, text in own.items() if key in Fin._fields}
    others = {key: value for key, value in fin.items() if key not in ("lift_slope", "induced_drag")}
    pulses = {key: int(value) for key, value in given.items() if key.endswith("_us")}
    return (others if "aspect_ratio" in given else fin) | given | pulses


def _coefficients(plugin: Element, path: str) -> dict[str, float] | None:
    """Return area, lift and drag coefficients of a plugin; None if it has no known tags.

    Its drag grows with the angle or its square, ours with the square of the lift: the constant is the best fit.
    """

    def number(tag: str, usual: str) -> float:
        return number_of(child_text(plugin, tag, f"liftdrag/{tag}") or usual, path)

    lift, drag = number("lift_constant", "0"), number("drag_constant", "0")
    if lift > 0.0:  # multiplied by speed² and angle: it includes area and density, and there is no stall
        area = 2.0 * lift / (_DENSITY * _SLOPE)
        return {
            "area": area, "lift_slope": _SLOPE, "induced_drag": 2.0 * drag / (_DENSITY * area * _SLOPE**2),
            "parasitic_drag": 0.0, "stall_angle": pi / 2.0,
        }  # fmt: skip
    area, slope, stall, rise = number("area", "0"), number("cla", "0"), number("alpha_stall", "0"), number("cda", "0")
    if area <= 0.0 or slope <= 0.0 or stall <= 0.0:
        return None
    stall = min(stall, pi / 2.0)
    induced = 1.25 * abs(rise) / (slope**2 * stall)
    return {"area": area, "lift_slope": slope, "induced_drag": induced, "parasitic_drag": 0.0, "stall_angle": stall}


def _left_out(name: str, plugin: Element, pose: Pose | None, lacks: str) -> str:
    """Return a note on a fin that is not imported, with its position and area."""
    where = ""
    if pose is not None:
        axis, chord = pose.rotate((0.0, 0.0, 1.0)), pose.rotate((1.0, 0.0, 0.0))
        where = (
            f", position {listed(to_frd(pose.position))}, axis {listed(to_frd(axis))}, chord {listed(to_frd(chord))}"
        )
    area = child_text(plugin, "area", "liftdrag/area")
    where += f", area {plain(area)} m²" if area else ""
    return f"Left out: the fin {name!r} ({lacks}){where}. Write it under [[fins]] with this name and --add it."
