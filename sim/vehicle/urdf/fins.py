"""Report the fins of a URDF. They are not imported: each plugin describes lift in its own way."""

from collections.abc import Iterator, Mapping

from sim.vehicle.urdf.pose import Pose
from sim.vehicle.urdf.text import Element, child_text, plain, to_frd

# uuv_simulator's libuuv_fin_ros_plugin.so, Gazebo's libLiftDragPlugin.so, gz-sim's gz-sim-lift-drag-system.
_FILES = ("uuv_fin", "fin_ros_plugin", "liftdrag", "lift-drag", "lift_drag")
_UPRIGHT, _ALONG = (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)


def left_out(robot: Element, poses: Mapping[str, Pose], given: set[str]) -> Iterator[str]:
    """A note for each fin or wing of the URDF, but for those of which `given` has the name: where it is, and its area.

    uuv_simulator's fins turn about their link's z and point along its x; for the others the plugin gives no more than
    the link to go by. A fin that two plugins name is reported once.
    """
    reported = set(given)
    for plugin in robot.iter("plugin"):
        file = plugin.get("filename", "").lower()
        link = child_text(plugin, "link_name", "linkName")
        if not any(part in file for part in _FILES) or not link:
            continue
        name = plain(link.rsplit("/", 1)[-1])
        if name in reported:
            continue
        reported.add(name)
        pose = poses.get(link)
        where = ""
        if pose is not None:
            place, axis, chord = pose.position, pose.turn(_UPRIGHT), pose.turn(_ALONG)
            where = f", position {_list(place)}, axis {_list(axis)}, chord {_list(chord)}"
        area = child_text(plugin, "area") or plugin.findtext("liftdrag/area")
        where += f", area {plain(area.strip())} m²" if area else ""
        yield f"Left out: the fin {name!r}{where}. Write it under [[fins]] with this name and --add it."


def _list(vector: tuple[float, ...]) -> str:
    return "[" + ", ".join(f"{x:.6g}" for x in (round(x, 9) + 0.0 for x in to_frd(vector))) + "]"
