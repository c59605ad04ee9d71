"""A network camera: its pictures as they come, by HTTP.

The paths are those of mjpg-streamer (github.com/jacksonliam/mjpg-streamer, plugin output_http).
"""

import threading
from collections.abc import Iterator, Mapping

from hil.client.client import Stamped
from hil.instruments.contract import Instrument, Response
from hil.ros.images import Picture

_BOUNDARY = "picture"
_WAIT_S = 0.5  # for a picture, until the connection is looked after


class NetworkCamera(Instrument):
    """A camera at `http://HOST:PORT/?action=stream` (MJPEG); `?action=snapshot` is one picture.

    Pictures have the rate, size and quality of the sensor and of `[ros] jpeg_quality`; it needs `[ros] images = "jpeg"`
    or `"both"`. What a client does not read in time it misses. Not simulated: RTSP and H.264.
    """

    sensors = ("camera",)
    at = ("http:127.0.0.1:8082",)
    wires = ("http",)
    part = "/image_raw/compressed"
    warm_up_s = 1.0

    _newest: Picture | None = None

    def start(self, now_ns: int) -> None:
        """Wait for pictures."""
        self._changed = threading.Condition()

    def on_sample(self, topic: str, stamped: Stamped, now_ns: int) -> None:
        """Take a picture."""
        with self._changed:
            self._newest = stamped.value
            self._changed.notify_all()

    def on_request(self, method: str, path: str, query: Mapping[str, str], body: bytes, now_ns: int) -> Response:
        """Answer with a picture, or with all that come."""
        action = query.get("action", "stream")
        if method != "GET" or path != "/" or action not in ("stream", "snapshot"):
            return Response(b"404 page not found\n", 404, "text/plain")
        if action == "snapshot":
            return Response(self._newest.data, 200, "image/jpeg") if self._newest else Response(b"", 503)
        return Response(content_type=f"multipart/x-mixed-replace;boundary={_BOUNDARY}", stream=self._pictures())

    def _pictures(self) -> Iterator[bytes]:
        """Yield each picture with its head, b"" while none comes; in the thread of a connection."""
        shown = None
        while True:
            with self._changed:
                if self._newest is shown:
                    self._changed.wait(_WAIT_S)
                picture, is_new = self._newest, self._newest is not shown
            shown = picture
            yield _part(picture) if picture and is_new else b""


def _part(picture: Picture) -> bytes:
    seconds, rest = divmod(picture.time_ns // 1000, 1_000_000)
    head = f"--{_BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(picture.data)}\r\n"
    return f"{head}X-Timestamp: {seconds}.{rest:06d}\r\n\r\n".encode() + picture.data + b"\r\n"
