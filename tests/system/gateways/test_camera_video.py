"""The pictures of a network camera as FFmpeg passes them on to a ground station: H.264 in RTP, joined late."""

import shlex
import shutil
import subprocess
from pathlib import Path

import pytest
from PIL import Image

from tests.support.documents import blocks
from tests.support.processes import PATIENCE_S, ROOT, Program, free_port, write_scenario

pytestmark = pytest.mark.skipif(not shutil.which("ffmpeg"), reason="ffmpeg is not installed")
PAGE = ROOT / "docs" / "how-to" / "qgroundcontrol.md"
SDP = """v=0
o=- 0 0 IN IP4 127.0.0.1
s=camera
c=IN IP4 127.0.0.1
t=0 0
m=video {port} RTP/AVP 96
a=rtpmap:96 H264/90000
"""


def test_a_ground_station_decodes_what_the_page_sends(tmp_path: Path) -> None:
    web, port = free_port(), free_port()
    (section,) = [block.text for block in blocks("toml", page=PAGE) if "network_camera" in block.text]
    (command,) = [each.text.replace("\\\n", "") for each in blocks("bash", page=PAGE) if "ffmpeg" in each.text]
    scenario, _ = write_scenario(tmp_path)
    scenario.write_text(scenario.read_text() + section.replace("8080", str(web)) + "width = 320\nheight = 240\n")
    (tmp_path / "stream.sdp").write_text(SDP.format(port=port), encoding="ascii")
    with Program(tmp_path, "slave", scenario) as slave:
        slave.expect("camera: .* at http:")
        sender = subprocess.Popen(shlex.split(command.replace("8080", str(web)).replace("5600", str(port))))
        try:
            subprocess.run(
                ["ffmpeg", "-hide_banner", "-loglevel", "error", "-protocol_whitelist", "file,udp,rtp", "-i",
                 str(tmp_path / "stream.sdp"), "-frames:v", "5", str(tmp_path / "%d.png")],
                check=True, timeout=PATIENCE_S,
            )  # fmt: skip
        finally:
            sender.terminate()
            sender.wait(60)
    shown = [Image.open(path).convert("RGB") for path in sorted(tmp_path.glob("*.png"))]
    assert [image.size for image in shown] == [(320, 240)] * 5
    assert all(len(set(image.tobytes())) > 10 for image in shown)
