"""Camera of the vehicle as a MAVLink camera: a component of its own, whose picture is H.264 in RTP over UDP."""

from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.common import __version__
from hil.common.clock import NS_PER_MS
from hil.links.mavlink.reports import MAVLINK_VERSION

COMPONENT: int = dialect.MAV_COMP_ID_CAMERA
STREAM = 1  # number of the one stream

MESSAGES = (
    dialect.MAVLINK_MSG_ID_CAMERA_INFORMATION, dialect.MAVLINK_MSG_ID_VIDEO_STREAM_INFORMATION,
    dialect.MAVLINK_MSG_ID_VIDEO_STREAM_STATUS, dialect.MAVLINK_MSG_ID_CAMERA_SETTINGS,
)  # fmt: skip


class CameraInfo(NamedTuple):
    """A camera's picture: the UDP port to which it is sent, pixels, rate (Hz), angle of view (degrees).

    Pixels, rate and angle are 0 if not known.
    """

    port: int
    width: int = 0
    height: int = 0
    rate: float = 0.0
    angle: float = 0.0


def heartbeat() -> Any:
    """Return the HEARTBEAT of the camera."""
    return dialect.MAVLink_heartbeat_message(
        dialect.MAV_TYPE_CAMERA, dialect.MAV_AUTOPILOT_INVALID, 0, 0, dialect.MAV_STATE_ACTIVE, MAVLINK_VERSION
    )


def message(info: CameraInfo, number: int, now: int) -> Any:
    """Return the message with one of the ids in MESSAGES."""
    if number == dialect.MAVLINK_MSG_ID_CAMERA_INFORMATION:
        return information(info, now)
    if number == dialect.MAVLINK_MSG_ID_CAMERA_SETTINGS:
        return settings(now)
    is_status = number == dialect.MAVLINK_MSG_ID_VIDEO_STREAM_STATUS
    return stream_status(info) if is_status else stream_information(info)


def information(info: CameraInfo, now: int) -> Any:
    """Return CAMERA_INFORMATION."""
    return dialect.MAVLink_camera_information_message(
        now // NS_PER_MS & 0xFFFF_FFFF, _padded("uuv-hil"), _padded(f"camera {__version__}"), 0, 0.0, 0.0, 0.0,
        info.width, info.height, 0, dialect.CAMERA_CAP_FLAGS_HAS_VIDEO_STREAM, 0, b"",
    )  # fmt: skip


def stream_information(info: CameraInfo) -> Any:
    """Return VIDEO_STREAM_INFORMATION."""
    return dialect.MAVLink_video_stream_information_message(
        STREAM, STREAM, dialect.VIDEO_STREAM_TYPE_RTPUDP, dialect.VIDEO_STREAM_STATUS_FLAGS_RUNNING, info.rate,
        info.width, info.height, 0, 0, round(info.angle), b"H.264", str(info.port).encode(),
        dialect.VIDEO_STREAM_ENCODING_H264,
    )  # fmt: skip


def stream_status(info: CameraInfo) -> Any:
    """Return VIDEO_STREAM_STATUS."""
    return dialect.MAVLink_video_stream_status_message(
        STREAM, dialect.VIDEO_STREAM_STATUS_FLAGS_RUNNING, info.rate, info.width, info.height, 0, 0, round(info.angle)
    )


def settings(now: int) -> Any:
    """Return CAMERA_SETTINGS: it makes video."""
    return dialect.MAVLink_camera_settings_message(now // NS_PER_MS & 0xFFFF_FFFF, dialect.CAMERA_MODE_VIDEO)


def _padded(text: str) -> list[int]:
    return list(text.encode()[:32].ljust(32, b"\0"))
