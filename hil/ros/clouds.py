"""sensor_msgs/PointCloud2 of a depth camera, and of a sonar's points."""

from array import array
from collections.abc import Sequence
from typing import NamedTuple

from hil.ros.message import Message, decode, encode, header, time_of

_TYPE = "sensor_msgs/msg/PointCloud2"
_FLOAT32 = 7  # constant of PointField
_FIELDS = [
    {"name": name, "offset": 4 * number, "datatype": _FLOAT32, "count": 1}
    for number, name in enumerate(("x", "y", "z", "rgb"))
]
_STEP = 4 * len(_FIELDS)  # bytes of a point
_STRENGTH_FIELDS = [*_FIELDS[:3], {**_FIELDS[3], "name": "intensity"}]


class Points(NamedTuple):
    """Points of a sonar along the axes of their frame (m), each with its echo strength (dB): x, y, z, intensity."""

    time_ns: int
    points: tuple[tuple[float, float, float, float], ...]


class Cloud(NamedTuple):
    """A cloud with the rows and columns of its picture, from the upper left, along the axes of its frame (REP 103).

    `data` has four 32-bit floats for each pixel: x right, y down, z ahead (m; nan without a point), and "rgb" with the
    bits 0x00RRGGBB, as in PCL and depth_image_proc.
    """

    time_ns: int
    width: int
    height: int
    data: bytes


def coloured(points: bytes, rgb: bytes) -> bytes:
    """Return the data of a `Cloud` from the points (sensor axes) and the colours of a CameraSample."""
    import numpy as np  # used only in the imaging process

    places = np.frombuffer(points, "<f4").reshape(-1, 3)
    cloud = np.empty((len(places), len(_FIELDS)), "<f4")
    cloud[:, :3] = places[:, (1, 2, 0)]
    red, green, blue = np.frombuffer(rgb, np.uint8).reshape(-1, 3).T.astype("<u4")
    cloud.view("<u4")[:, 3] = red << 16 | green << 8 | blue
    return cloud.tobytes()


def encode_cloud(cloud: Cloud, frame: str = "camera_optical_frame") -> bytes:
    """Return the PointCloud2 message of a cloud."""
    head = header(cloud.time_ns, frame)
    size = {"height": cloud.height, "width": cloud.width, "point_step": _STEP, "row_step": _STEP * cloud.width}
    return encode(_TYPE, {"header": head, **size, "fields": _FIELDS, "data": cloud.data})


def decode_cloud(data: bytes) -> Cloud | None:
    """Return a cloud with these fields and without gaps between points; None for any other."""
    message = decode(_TYPE, data)
    if message is None or not _is_ours(message):
        return None
    return Cloud(time_of(message), message["width"], message["height"], message["data"])


def _is_ours(message: Message) -> bool:
    row = _STEP * message["width"]
    steps = message["point_step"] == _STEP and message["row_step"] == row
    whole = len(message["data"]) == row * message["height"]
    return steps and whole and message["fields"] == _FIELDS and not message["is_bigendian"]


def encode_points(time_ns: int, points: Sequence[tuple[float, float, float, float]], frame: str) -> bytes:
    """Return points with echo strengths as a message, an unordered cloud."""
    data = array("f", [value for point in points for value in point])
    size = {"height": 1, "width": len(points), "point_step": _STEP, "row_step": _STEP * len(points)}
    shape = {"fields": _STRENGTH_FIELDS, "is_dense": True, "data": data.tobytes()}
    return encode(_TYPE, {"header": header(time_ns, frame), **size, **shape})


def decode_points(data: bytes) -> Points | None:
    """Return points with echo strengths; None for a cloud with other fields."""
    message = decode(_TYPE, data)
    if message is None or message["fields"] != _STRENGTH_FIELDS or message["is_bigendian"]:
        return None
    if message["point_step"] != _STEP or len(message["data"]) != _STEP * message["width"] * message["height"]:
        return None
    values = array("f")
    values.frombytes(message["data"])
    rows = [(*values[i : i + 4],) for i in range(0, len(values), 4)]
    return Points(time_of(message), tuple(rows))  # type: ignore[arg-type]
