"""ROS 2 messages of commands other than cmd_vel; frames and rules are those of hil.ros.encoders.

Values that are not finite, or beyond what any vehicle can do, count as malformed.
"""

from collections.abc import Callable, Sequence
from math import atan2, cos, isfinite, sin
from typing import NamedTuple

from hil.common.vectors import Vector3
from hil.ros.cdr import HEADER, Layout, MalformedError, Writer, text, tolerant
from hil.ros.encoders import Decoder, array_values, pack_stamped, swap_attitude, swap_body, swap_world
from hil.ros.frames import decode_wrench

MAX_DEPTH = 11_000.0  # m
MAX_HEADING = 100.0  # rad; several turns, which do no harm
MAX_PLACE = 1e6  # m
MAX_FORCE = 1e6  # N, N m
WORLD_FRAMES = ("", "map", "odom")  # all the same frame

_NUMBER = Layout("d")
_POSE = Layout("i I string 7d")
_STAMPED = Layout("i I string 6d")
_MIN_NORM = 0.5  # squared norm of a valid quaternion

Six = tuple[float, float, float, float, float, float]


class PoseCommand(NamedTuple):
    """Pose to reach: `position` m NED, `heading` rad from north, clockwise. Roll and pitch stay zero."""

    position: Vector3
    heading: float


def encode_number(value: float) -> bytes:
    """Encode std_msgs/Float64: a depth in m, or a compass heading in rad from north, clockwise seen from above."""
    return _NUMBER.struct().pack(HEADER, value)


def _number_within(most: float) -> Callable[[bytes], float | None]:
    @tolerant
    def decode(data: bytes) -> float:
        return float(_bounded(_NUMBER.unpack(data)[1:], most)[0])

    return decode


def encode_pose(command: PoseCommand, time_ns: int, frame: str = "map") -> bytes:
    """Encode geometry_msgs/PoseStamped in the world `frame`."""
    half = 0.5 * command.heading
    w, x, y, z = swap_attitude((cos(half), 0.0, 0.0, sin(half)))
    return pack_stamped(_POSE, time_ns, (frame,), *swap_world(command.position), x, y, z, w)


@tolerant
def decode_pose(data: bytes) -> PoseCommand:
    """Return position and heading; roll and pitch are ignored.

    A pose in another frame than the world's is malformed.
    """
    _, _, _, _, frame, *position, x, y, z, w = _POSE.unpack(data)
    if text(frame).rpartition("/")[2] not in WORLD_FRAMES:
        raise MalformedError("not in the world's frame")
    w, x, y, z = swap_attitude(_bounded((w, x, y, z), 2.0))
    if w * w + x * x + y * y + z * z < _MIN_NORM:
        raise MalformedError("not an attitude")
    heading = atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)
    return PoseCommand(swap_world(_bounded(position, MAX_PLACE)), heading)


@tolerant
def decode_stamped_twist(data: bytes) -> tuple[Vector3, Vector3]:
    """Return linear (m/s) and angular (rad/s) velocity along FRD.

    A velocity in the world frame is malformed: it has to be along the body's axes. The header's stamp is ignored,
    because the attachment gives each message's age.
    """
    _, _, _, _, frame, x, y, z, p, q, r = _STAMPED.unpack(data)
    if text(frame).rpartition("/")[2] in ("map", "odom"):
        raise MalformedError("not in the body's frame")
    if not all(isfinite(value) for value in (x, y, z, p, q, r)):
        raise MalformedError("not a velocity")
    return swap_body((x, y, z)), swap_body((p, q, r))


@tolerant
def decode_wrench_command(data: bytes) -> Six:
    """Return X Y Z (N) and K M N (N m) along FRD; any frame name is taken for the body's."""
    wrench = decode_wrench(data)
    if wrench is None:
        raise MalformedError("not a wrench")
    x, y, z, k, m, n = _bounded((*wrench[1], *wrench[2]), MAX_FORCE)
    return x, y, z, k, m, n


def encode_thrusts(thrusts: Sequence[float]) -> bytes:
    """Encode std_msgs/Float64MultiArray without dimensions: each thruster's thrust in N, in the vehicle's order."""
    writer = Writer()
    writer.numbers("I", 0, 0, len(thrusts))  # no dimensions, no offset
    writer.numbers("d", *thrusts)
    return bytes(writer.data)


@tolerant
def decode_thrusts(data: bytes) -> tuple[float, ...]:
    """Return the thrusts in N; dimensions are ignored."""
    return tuple(_bounded(array_values(data, "d"), MAX_FORCE))


def _bounded(values: Sequence[float], most: float) -> Sequence[float]:
    if not all(isfinite(value) and abs(value) <= most for value in values):
        raise MalformedError("not a number that can be meant")
    return values


DECODERS: dict[str, Decoder] = {
    "cmd_vel_stamped": decode_stamped_twist,
    "cmd_depth": _number_within(MAX_DEPTH),
    "cmd_heading": _number_within(MAX_HEADING),
    "cmd_pose": decode_pose,
    "cmd_wrench": decode_wrench_command,
    "cmd_thrusters": decode_thrusts,
}
