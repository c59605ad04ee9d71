"""Transforms, the simulation clock, and the thruster wrench as ROS 2 messages."""

from collections.abc import Sequence
from typing import NamedTuple

from hil.common.vectors import Quaternion, Vector3
from hil.ros.cdr import HEADER, Layout, Reader, Writer, tolerant
from hil.ros.encoders import Decoder, pack_stamped, swap_body, unpack_stamped

_NS_PER_S = 1_000_000_000
_CLOCK = Layout("i I")
_WRENCH = Layout("i I string 6d")


class Transform(NamedTuple):
    """Pose of the axes `child` in `frame`: m, quaternion (w, x, y, z) from `child` to `frame`. Axes are FLU or ENU."""

    time_ns: int
    frame: str
    child: str
    translation: Vector3
    rotation: Quaternion


def mounted(time_ns: int, frame: str, child: str, position: Sequence[float], attitude: Quaternion) -> Transform:
    """Return the FLU transform of an object at `position` (m) with `attitude`, both along the FRD axes of `frame`."""
    w, x, y, z = attitude
    return Transform(time_ns, frame, child, swap_body(position), (w, x, -y, -z))


def encode_transforms(transforms: Sequence[Transform]) -> bytes:
    """Encode tf2_msgs/TFMessage."""
    writer = Writer()
    writer.numbers("I", len(transforms))
    for time_ns, frame, child, translation, (w, x, y, z) in transforms:
        writer.numbers("i", time_ns // _NS_PER_S)
        writer.numbers("I", time_ns % _NS_PER_S)
        writer.string(frame)
        writer.string(child)
        writer.numbers("d", *translation, x, y, z, w)
    return bytes(writer.data)


@tolerant
def decode_transforms(data: bytes) -> list[Transform]:
    """Return all transforms of the message."""
    reader = Reader(data)
    return [_transform(reader) for _ in range(reader.count())]


def _transform(reader: Reader) -> Transform:
    (seconds,), (ns,) = reader.numbers("i"), reader.numbers("I")
    frame, child = reader.string(), reader.string()
    a, b, c, x, y, z, w = reader.numbers("d", 7)
    return Transform(seconds * _NS_PER_S + ns, frame, child, (a, b, c), (w, x, y, z))


def encode_clock(time_ns: int) -> bytes:
    """Encode rosgraph_msgs/Clock."""
    return _CLOCK.struct().pack(HEADER, *divmod(time_ns, _NS_PER_S))


@tolerant
def decode_clock(data: bytes) -> int:
    """Return the time in ns."""
    _, seconds, ns = _CLOCK.unpack(data)
    return int(seconds * _NS_PER_S + ns)


def encode_wrench(time_ns: int, wrench: Sequence[float], frame: str = "base_link") -> bytes:
    """Encode geometry_msgs/WrenchStamped from X Y Z (N) and K M N (N m) about the origin of `frame`, along FRD."""
    return pack_stamped(_WRENCH, time_ns, (frame,), *swap_body(wrench[:3]), *swap_body(wrench[3:]))


@tolerant
def decode_wrench(data: bytes) -> tuple[int, Vector3, Vector3]:
    """Return time (ns), force (N) and moment (N m) along FRD."""
    time_ns, values = unpack_stamped(_WRENCH, data)
    return time_ns, swap_body(values[:3]), swap_body(values[3:])


DECODERS: dict[str, Decoder] = {
    "/clock": decode_clock,
    "/tf": decode_transforms,
    "/tf_static": decode_transforms,
    "thruster_wrench": decode_wrench,
}
