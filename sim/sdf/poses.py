"""Poses of SDF: a `<pose>` in its three notations, and the frames to which poses are relative."""

from collections.abc import Mapping
from math import radians

from hil.common.errors import ConfigError
from sim.vehicle.urdf.pose import Pose, pose_at, pose_with
from sim.vehicle.urdf.text import Element, numbers_of

MODEL = "__model__"
_MAX_STEPS = 100  # from frame to frame
Frames = Mapping[str, tuple[str, Pose]]  # name -> its parent frame, and its pose relative to that


def own_pose(element: Element | None, path: str) -> Pose:
    """Return the `<pose>` of an element as it is written: six numbers, or three and a quaternion (x, y, z, w).

    The identity if there is none. Raises ConfigError.
    """
    pose = element.find("pose") if element is not None else None
    if pose is None or not (pose.text or "").strip():
        return Pose()
    is_quaternion = pose.get("rotation_format") == "quat_xyzw"
    x, y, z, *turn = numbers_of(pose.text or "", path, *((7,) if is_quaternion else (6, 3)))
    if is_quaternion:
        return pose_with((x, y, z), turn)
    turn = turn or [0.0, 0.0, 0.0]
    in_degrees = (pose.get("degrees") or "").strip().lower() in ("1", "true")
    return pose_at((x, y, z), [radians(angle) for angle in turn] if in_degrees else turn)


def relative_to(element: Element, default: str) -> str:
    """Return the name of the frame that the `<pose>` of an element refers to."""
    pose = element.find("pose")
    if pose is None:
        return default
    return pose.get("relative_to") or pose.get("frame") or default  # `frame` was its name up to SDF 1.6


def resolve(name: str, frames: Frames, path: str) -> Pose:
    """Return the pose of a frame in the model's frame. Raises ConfigError if it is missing or relative to itself."""
    pose, start = Pose(), name
    for _ in range(_MAX_STEPS):
        if name in (MODEL, ""):
            return pose
        if name not in frames:
            raise ConfigError(f"{path}: a pose is relative to {name!r}, which is not there")
        name, own = frames[name]
        pose = own.then(pose)
    raise ConfigError(f"{path}: the frame {start!r} is placed relative to itself")
