"""Camera of the vehicle as a MAVLink camera: a component of its own, whose picture is at an address."""

from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil import __version__
from hil.common.clock import NS_PER_MS
from hil.links.mavlink.reports import MAVLINK_VERSION

COMPONENT: int = dialect.MAV_COMP_ID_CAMERA


class CameraInfo(NamedTuple):
    """Address and properties of a camera's picture: pixels, rate (Hz), angle of view (degrees); 0 if not known yet."""

    address: str
    width: int = 0
    height: int = 0
    rate: float = 0.0
    angle: float = 0.0


def heartbeat() -> Any:
    """Return the HEARTBEAT of the camera."""
    return dialect.MAVLink_heartbeat_message(
        dialect.MAV_TYPE_CAMERA, dialect.MAV_AUTOPILOT_INVALID, 0, 0, dialect.MAV_STATE_ACTIVE, MAVLINK_VERSION
    )


def information(info: CameraInfo, now: int) -> Any:
    """Return CAMERA_INFORMATION."""
    return dialect.MAVLink_camera_information_message(
        now // NS_PER_MS & 0xFFFF_FFFF, _padded("uuv-hil"), _padded(f"camera {__version__}"), 0, 0.0, 0.0, 0.0,
        info.width, info.height, 0, dialect.CAMERA_CAP_FLAGS_HAS_VIDEO_STREAM, 0, b"",
    )  # fmt: skip


def stream_information(info: CameraInfo) -> Any:
    """Return VIDEO_STREAM_INFORMATION. MAVLink has no word for MJPEG over HTTP: the address says it."""
    return dialect.MAVLink_video_stream_information_message(
        1, 1, dialect.VIDEO_STREAM_TYPE_RTSP, dialect.VIDEO_STREAM_STATUS_FLAGS_RUNNING, info.rate, info.width,
        info.height, 0, 0, round(info.angle), b"MJPEG", info.address.encode(), dialect.VIDEO_STREAM_ENCODING_UNKNOWN,
    )  # fmt: skip


def stream_status(info: CameraInfo) -> Any:
    """Return VIDEO_STREAM_STATUS."""
    return dialect.MAVLink_video_stream_status_message(
        1, dialect.VIDEO_STREAM_STATUS_FLAGS_RUNNING, info.rate, info.width, info.height, 0, 0, round(info.angle)
    )


def settings(now: int) -> Any:
    """Return CAMERA_SETTINGS: it makes video."""
    return dialect.MAVLink_camera_settings_message(now // NS_PER_MS & 0xFFFF_FFFF, dialect.CAMERA_MODE_VIDEO)


def _padded(text: str) -> list[int]:
    return list(text.encode()[:32].ljust(32, b"\0"))
