"""The frames of SDF to which poses are relative."""

from collections.abc import Mapping

from hil.common.errors import ConfigError
from sim.vehicle.urdf.pose import Pose
from sim.vehicle.urdf.text import Element

MODEL = "__model__"
_MAX_STEPS = 100  # from frame to frame
Frames = Mapping[str, tuple[str, Pose]]  # name -> its parent frame, and its pose relative to that


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
