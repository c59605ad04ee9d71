"""The camera's picture as H.264 in RTP over UDP, as QGroundControl shows it at its port 5600.

Pictures come as JPEG; FFmpeg's libraries decode and encode them (PyAV), in a thread of their own. Parameter sets are
repeated with each key picture, once a second, so that a viewer that comes later needs no session description.
"""

import contextlib
import socket
import threading
from fractions import Fraction
from typing import Any

from hil.common.clock import NS_PER_S, now_ns
from hil.common.errors import NetworkError

CLOCK_HZ = 90_000  # of RTP's time stamps for video (RFC 6184)
PACKET = 1200  # bytes; below the MTU of every usual network
KEY_S = 1.0  # between two key pictures
WAIT_S = 0.5
ENCODER = {"preset": "ultrafast", "tune": "zerolatency", "profile": "baseline", "forced-idr": "1"}


class RtpVideo:
    """Sends the newest picture to a `host` and `port`. Use as a context. Raises ImportError, NetworkError.

    `rate` (Hz) is that of the camera, 0 if not known. `sent` counts encoded pictures, `malformed` what was no JPEG.
    """

    def __init__(self, host: str, port: int, rate: float) -> None:
        import av  # the command line names the extra

        try:
            socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)
        except OSError as error:
            raise NetworkError(f"rtp: {host}:{port}: {error.strerror}; give HOST:PORT of a ground station") from None
        self.port, self.sent, self.malformed = port, 0, 0
        self._av: Any = av
        self._target = f"rtp://{f'[{host}]' if ':' in host else host}:{port}?pkt_size={PACKET}"
        self._rate = rate or 10.0
        self._picture = b""
        self._changed = threading.Condition()
        self._is_ending = False
        self._output: Any = None  # the container of the present size
        self._encoder: Any = None
        self._size = (0, 0)
        self._began_ns = now_ns()
        self._key_ns = 0
        self._thread = threading.Thread(target=self._run, name="rtp", daemon=True)
        self._thread.start()

    def __enter__(self) -> "RtpVideo":
        return self

    def __exit__(self, *_: object) -> None:
        with self._changed:
            self._is_ending = True
            self._changed.notify()
        self._thread.join(2.0)

    def show(self, jpeg: bytes) -> None:
        """Send a new picture; one that still waits for the encoder is dropped."""
        with self._changed:
            self._picture = jpeg
            self._changed.notify()

    def _run(self) -> None:
        while not self._is_ending:
            with self._changed:
                self._changed.wait_for(lambda: self._picture or self._is_ending, WAIT_S)
                jpeg, self._picture = self._picture, b""
            if jpeg:
                self._send(jpeg)
        self._close()

    def _send(self, jpeg: bytes) -> None:
        av = self._av
        try:
            frame = av.CodecContext.create("mjpeg", "r").decode(av.Packet(jpeg))[0]
        except (av.FFmpegError, IndexError):
            self.malformed += 1
            return
        now = now_ns()
        try:
            size = frame.width & ~1, frame.height & ~1  # colours have half the pixels
            if size != self._size:
                self._open(size)
            frame = frame.reformat(*size, format="yuv420p")
            frame.pts, frame.time_base = (now - self._began_ns) * CLOCK_HZ // NS_PER_S, Fraction(1, CLOCK_HZ)
            if now >= self._key_ns:
                self._key_ns = now + round(KEY_S * NS_PER_S)
                frame.pict_type = av.video.frame.PictureType.I
            for packet in self._encoder.encode(frame):
                self._output.mux(packet)
            self.sent += 1
        except (av.FFmpegError, OSError):  # the network is down; the next picture opens it
            self._close()

    def _open(self, size: tuple[int, int]) -> None:
        av = self._av
        self._close()
        self._output = av.open(self._target, "w", format="rtp")
        encoder = self._encoder = self._output.add_stream("libx264", rate=round(self._rate) or 1, options=ENCODER)
        encoder.width, encoder.height = size
        encoder.pix_fmt = "yuv420p"
        encoder.codec_context.time_base = Fraction(1, CLOCK_HZ)
        encoder.codec_context.thread_count = 1
        self._size, self._key_ns = size, 0

    def _close(self) -> None:
        if self._output:
            with contextlib.suppress(self._av.FFmpegError, OSError):
                self._output.close()
        self._output, self._size = None, (0, 0)
