"""The report of a vehicle to others of its formation: its estimated position, and its progress in their plan.

It is a trajectory_msgs/MultiDOFJointTrajectoryPoint with one transform, the pose, and the time since the plan's start.
"""

from math import isfinite
from typing import NamedTuple

from hil.common.vectors import Quaternion, Vector3
from hil.ros.cdr import HEADER, Layout, MalformedError, tolerant
from hil.ros.encoders import Decoder, swap_attitude, swap_world

_NS_PER_S = 1_000_000_000
_POINT = Layout("I 7d I I i I")  # one transform, no velocities, no accelerations


class FormationSample(NamedTuple):
    """A vehicle's own estimate of its position (m, NED) and attitude (FRD in NED), and its time in the plan (ns)."""

    position: Vector3
    orientation: Quaternion
    clock_ns: int


def encode_formation(sample: FormationSample) -> bytes:
    """Encode trajectory_msgs/MultiDOFJointTrajectoryPoint; the transform is the pose of FLU in ENU."""
    w, x, y, z = swap_attitude(sample.orientation)
    elapsed = divmod(sample.clock_ns, _NS_PER_S)
    return _POINT.struct().pack(HEADER, 1, *swap_world(sample.position), x, y, z, w, 0, 0, *elapsed)


@tolerant
def decode_formation(data: bytes) -> FormationSample:
    """Return the sample in NED and FRD. More than one transform, or values not finite, count as malformed."""
    _, transforms, east, north, up, x, y, z, w, velocities, accelerations, seconds, ns = _POINT.unpack(data)
    if (transforms, velocities, accelerations) != (1, 0, 0) or not all(map(isfinite, (east, north, up, x, y, z, w))):
        raise MalformedError("not the place of one vehicle")
    return FormationSample(swap_world((east, north, up)), swap_attitude((w, x, y, z)), seconds * _NS_PER_S + ns)


DECODERS: dict[str, Decoder] = {"formation": decode_formation}
