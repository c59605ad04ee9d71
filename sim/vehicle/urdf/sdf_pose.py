"""Read a `<pose>` of SDF in its three notations; the `<gazebo>` elements of a URDF have it too."""

from math import radians

from sim.vehicle.urdf.pose import Pose, pose_at, pose_with
from sim.vehicle.urdf.text import Element, numbers_of


def own_pose(element: Element | None, path: str) -> Pose:
    """Return the `<pose>` of an element as it is written: six numbers, or three and a quaternion (x, y, z, w).

    The identity if there is none. Raises ConfigError.
    """
    pose = element.find("pose") if element is not None else None
    if pose is None or not (pose.text or "").strip():
        return Pose()
    is_quaternion = pose.get("rotation_format") == "quat_xyzw"
    x, y, z, *rotation = numbers_of(pose.text or "", path, *((7,) if is_quaternion else (6, 3)))
    if is_quaternion:
        return pose_with((x, y, z), rotation)
    rotation = rotation or [0.0, 0.0, 0.0]
    in_degrees = (pose.get("degrees") or "").strip().lower() in ("1", "true")
    return pose_at((x, y, z), [radians(angle) for angle in rotation] if in_degrees else rotation)
