"""The camera's picture as MJPEG over HTTP, on this machine only: for browsers, ffmpeg and GStreamer."""

import threading
from collections.abc import Callable

from hil.common.errors import NetworkError
from hil.common.web.plain_server import PlainHandler, PlainHttpServer

BOUNDARY = "uuv-hil-picture"
SILENT_S = 10.0  # after which a stream without a new picture ends
MAX_VIEWERS = 8


class VideoServer:
    """Serves the newest JPEG at "/", one response without end for each viewer. Use as a context. Raises NetworkError.

    `on_viewer` is called when the first viewer comes: pictures are not fetched before.
    """

    def __init__(self, port: int, on_viewer: Callable[[], None] = lambda: None) -> None:
        self.changed = threading.Condition()
        self.picture: bytes = b""
        self.count = 0
        self.viewers = 0
        self.on_viewer = on_viewer
        self.is_ending = False
        handler = type("Handler", (_Handler,), {"video": self})
        try:
            self._server = PlainHttpServer("video", ("127.0.0.1", port), handler)
        except OSError as error:
            raise NetworkError(f"video: 127.0.0.1:{port}: {error.strerror}; choose another video_port") from None
        self.port: int = self._server.server_port
        self._server.start()

    def __enter__(self) -> "VideoServer":
        return self

    def __exit__(self, *_: object) -> None:
        with self.changed:
            self.is_ending = True
            self.changed.notify_all()
        self._server.stop()

    @property
    def address(self) -> str:
        """Return where it is, as a URL."""
        return f"http://127.0.0.1:{self.port}/"

    def show(self, jpeg: bytes) -> None:
        """Show a new picture to all viewers."""
        with self.changed:
            self.picture, self.count = jpeg, self.count + 1
            self.changed.notify_all()


class _Handler(PlainHandler):
    video: VideoServer

    def do_GET(self) -> None:  # noqa: N802 - http.server's name
        """Answer with a stream of pictures."""
        video = self.video
        if self.path != "/":
            self.send_error(404)
            return
        with video.changed:
            if video.viewers >= MAX_VIEWERS:
                self.send_error(503)
                return
            video.viewers += 1
        try:
            video.on_viewer()
            self._stream(video)
        except OSError:  # the viewer has closed
            return
        finally:
            with video.changed:
                video.viewers -= 1

    def _stream(self, video: VideoServer) -> None:
        self.send_response(200)
        self.send_header("Content-Type", f"multipart/x-mixed-replace; boundary={BOUNDARY}")
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
        number = 0
        while True:
            with video.changed:
                video.changed.wait_for(lambda last=number: video.count != last or video.is_ending, SILENT_S)  # type: ignore[misc]
                if video.is_ending or video.count == number:
                    return
                picture, number = video.picture, video.count
            head = f"--{BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(picture)}\r\n\r\n"
            self.wfile.write(head.encode() + picture + b"\r\n")
