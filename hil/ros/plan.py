"""Encode and decode nav_msgs/Path: the path of a planner, or the shape of a tether."""

from collections.abc import Sequence

from hil.common.vectors import Vector3
from hil.ros.cdr import MalformedError, tolerant
from hil.ros.encoders import Decoder, swap_world
from hil.ros.message import encode, header, read

TYPE = "nav_msgs/msg/Path"
FRAME = "map"
MAX_POINTS = 2000  # in one message; of a longer path every second point is left out, repeatedly


def encode_plan(time_ns: int, path: Sequence[Sequence[float]], depth: float) -> bytes:
    """Return a nav_msgs/Path of positions (m, NED); those with two numbers are at `depth`."""
    while len(path) > MAX_POINTS:
        path = [*path[:-1:2], path[-1]]
    head = header(time_ns, FRAME)
    poses = []
    for place in path:
        x, y, z = swap_world((place[0], place[1], place[2] if len(place) > 2 else depth))
        poses.append({"header": head, "pose": {"position": {"x": x, "y": y, "z": z}}})
    return encode(TYPE, {"header": head, "poses": poses})


@tolerant
def decode_plan(data: bytes) -> tuple[Vector3, ...]:
    """Return the positions in a nav_msgs/Path, m, NED."""
    message = read(TYPE, data)
    if len(message["poses"]) > MAX_POINTS:
        raise MalformedError("not a path")
    places = [pose["pose"]["position"] for pose in message["poses"]]
    return tuple([swap_world((place["x"], place["y"], place["z"])) for place in places])


DECODERS: dict[str, Decoder] = {"plan": decode_plan, "tether": decode_plan}
