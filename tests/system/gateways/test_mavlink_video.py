"""The video stream of the camera, H.264 in RTP joined late, decoded by ffmpeg."""

import io
import shutil
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from PIL import Image

from hil.gateways.mavlink.rtp import RtpVideo
from tests.support.processes import PATIENCE_S, free_port

pytestmark = pytest.mark.skipif(not shutil.which("ffmpeg"), reason="ffmpeg is not installed")
SIZE = (320, 240)
LEFT, RIGHT = (200, 40, 40), (40, 40, 200)
SDP = """v=0
o=- 0 0 IN IP4 127.0.0.1
s=camera
c=IN IP4 127.0.0.1
t=0 0
m=video {port} RTP/AVP 96
a=rtpmap:96 H264/90000
"""


def picture() -> bytes:
    """Return a picture that is half red and half blue."""
    image = Image.new("RGB", SIZE, LEFT)
    image.paste(RIGHT, (SIZE[0] // 2, 0, *SIZE))
    written = io.BytesIO()
    image.save(written, "JPEG", quality=90)
    return written.getvalue()


@contextmanager
def camera(show: Callable[[bytes], None]) -> Iterator[None]:
    """Show the picture ten times a second."""
    ending, jpeg = threading.Event(), picture()

    def run() -> None:
        while not ending.wait(0.1):
            show(jpeg)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    yield
    ending.set()
    thread.join()


def frames(folder: Path, *source: str) -> list[Image.Image]:
    """Return the first five pictures that ffmpeg decodes."""
    subprocess.run(
        ["ffmpeg", "-hide_banner", "-loglevel", "error", *source, "-frames:v", "5", str(folder / "%d.png")],
        check=True, timeout=PATIENCE_S,
    )  # fmt: skip
    return [Image.open(path).convert("RGB") for path in sorted(folder.glob("*.png"))]


def check(shown: list[Image.Image]) -> None:
    assert len(shown) == 5
    for image in shown:
        assert image.size == SIZE
        for place, wanted in (((80, 120), LEFT), ((240, 120), RIGHT)):
            found = image.getpixel(place)
            assert isinstance(found, tuple)
            assert all(abs(a - b) < 40 for a, b in zip(found, wanted, strict=True)), (place, found)


def test_h264_in_rtp_joined_late_is_decoded(tmp_path: Path) -> None:
    port = free_port()
    (tmp_path / "stream.sdp").write_text(SDP.format(port=port), encoding="ascii")
    with RtpVideo("127.0.0.1", port, 10.0) as video, camera(video.show):
        deadline = time.monotonic() + PATIENCE_S
        while video.sent < 15 and time.monotonic() < deadline:  # beyond the first key picture
            time.sleep(0.05)
        check(
            frames(
                tmp_path,
                "-protocol_whitelist",
                "file,udp,rtp",
                "-flags",
                "low_delay",
                "-i",
                str(tmp_path / "stream.sdp"),
            )
        )
        video.show(b"no picture")
        while not video.malformed and time.monotonic() < deadline:
            time.sleep(0.05)
    assert video.malformed == 1
