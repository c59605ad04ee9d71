"""Camera of the vehicle as a MAVLink camera: a component of its own, whose picture is at an address."""

from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.common import __version__
from hil.common.clock import NS_PER_MS
from hil.links.mavlink.reports import MAVLINK_VERSION

COMPONENT: int = dialect.MAV_COMP_ID_CAMERA

MESSAGES = (
    dialect.MAVLINK_MSG_ID_CAMERA_INFORMATION, dialect.MAVLINK_MSG_ID_VIDEO_STREAM_INFORMATION,
    dialect.MAVLINK_MSG_ID_VIDEO_STREAM_STATUS, dialect.MAVLINK_MSG_ID_CAMERA_SETTINGS,
)  # fmt: skip


class Stream(NamedTuple):
    """One stream of the picture: what it is called, its address or (RTP) its UDP port, and MAVLink's words for it."""

    name: str
    address: str
    kind: int
    encoding: int


class CameraInfo(NamedTuple):
    """Streams and properties of a camera's picture: pixels, rate (Hz), angle of view (degrees); 0 if not known yet."""

    streams: tuple[Stream, ...]
    width: int = 0
    height: int = 0
    rate: float = 0.0
    angle: float = 0.0


def mjpeg(address: str) -> Stream:
    """Return the stream of MJPEG over HTTP, for which MAVLink has no field: the address has it."""
    kind, encoding = dialect.VIDEO_STREAM_TYPE_RTSP, dialect.VIDEO_STREAM_ENCODING_UNKNOWN
    return Stream("MJPEG", address, kind, encoding)


def h264(port: int) -> Stream:
    """Return the stream of H.264 in RTP to this UDP port of the ground station."""
    return Stream("H.264", str(port), dialect.VIDEO_STREAM_TYPE_RTPUDP, dialect.VIDEO_STREAM_ENCODING_H264)


def heartbeat() -> Any:
    """Return the HEARTBEAT of the camera."""
    return dialect.MAVLink_heartbeat_message(
        dialect.MAV_TYPE_CAMERA, dialect.MAV_AUTOPILOT_INVALID, 0, 0, dialect.MAV_STATE_ACTIVE, MAVLINK_VERSION
    )


def messages(info: CameraInfo, number: int, now: int) -> list[Any]:
    """Return the messages with one of the ids in MESSAGES."""
    if number == dialect.MAVLINK_MSG_ID_CAMERA_INFORMATION:
        return [information(info, now)]
    if number == dialect.MAVLINK_MSG_ID_CAMERA_SETTINGS:
        return [settings(now)]
    is_status = number == dialect.MAVLINK_MSG_ID_VIDEO_STREAM_STATUS
    return stream_status(info) if is_status else stream_information(info)


def information(info: CameraInfo, now: int) -> Any:
    """Return CAMERA_INFORMATION."""
    return dialect.MAVLink_camera_information_message(
        now // NS_PER_MS & 0xFFFF_FFFF, _padded("uuv-hil"), _padded(f"camera {__version__}"), 0, 0.0, 0.0, 0.0,
        info.width, info.height, 0, dialect.CAMERA_CAP_FLAGS_HAS_VIDEO_STREAM, 0, b"",
    )  # fmt: skip


def stream_information(info: CameraInfo) -> list[Any]:
    """Return a VIDEO_STREAM_INFORMATION of each stream."""
    return [
        dialect.MAVLink_video_stream_information_message(
            number, len(info.streams), stream.kind, dialect.VIDEO_STREAM_STATUS_FLAGS_RUNNING, info.rate, info.width,
            info.height, 0, 0, round(info.angle), stream.name.encode(), stream.address.encode(), stream.encoding,
        )
        for number, stream in enumerate(info.streams, 1)
    ]  # fmt: skip


def stream_status(info: CameraInfo) -> list[Any]:
    """Return a VIDEO_STREAM_STATUS of each stream."""
    return [
        dialect.MAVLink_video_stream_status_message(
            number, dialect.VIDEO_STREAM_STATUS_FLAGS_RUNNING, info.rate, info.width, info.height, 0, 0,
            round(info.angle),
        )
        for number, _ in enumerate(info.streams, 1)
    ]  # fmt: skip


def settings(now: int) -> Any:
    """Return CAMERA_SETTINGS: it makes video."""
    return dialect.MAVLink_camera_settings_message(now // NS_PER_MS & 0xFFFF_FFFF, dialect.CAMERA_MODE_VIDEO)


def _padded(text: str) -> list[int]:
    return list(text.encode()[:32].ljust(32, b"\0"))
