"""The C header of our frame: as the tool makes it, and its numbers against bytes."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

from hil.common.schema import find_preset
from hil.links.contract import ThrusterCommand, ThrusterTelemetry
from hil.links.frame.protocol import FrameProtocol

ROOT = Path(__file__).parents[3]
HEADER = ROOT / "firmware_stub" / "include" / "uuv_hil_frame.h"
PULSES = (1101, 1202, 1303)


def value(name: str, thrusters: int = len(PULSES)) -> int:
    """Evaluate a macro of the header by Python, whose arithmetic is that of C here."""
    found = re.search(rf"^#define UUV_HIL_FRAME_{name}(?:\(n\))? (.*?)(?: /\*.*)?$", HEADER.read_text(), re.MULTILINE)
    assert found, name
    return int(eval(re.sub(r"\b(0x[0-9A-F]+|\d+)u", r"\1", found[1]), {"n": thrusters}))


def test_the_header_is_what_the_frame_file_says() -> None:
    done = subprocess.run(
        [sys.executable, "tools/frame_header.py", "--check"], cwd=ROOT, capture_output=True, text=True
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_a_header_that_is_not_up_to_date_is_reported(tmp_path: Path) -> None:
    for folder in ("tools", "hil", "firmware_stub"):
        shutil.copytree(ROOT / folder, tmp_path / folder, ignore=shutil.ignore_patterns("__pycache__", "images"))
    frame = tmp_path / "firmware_stub" / "frames" / "uuv_hil.toml"
    frame.write_text(frame.read_text().replace("id = 0x02", "id = 0x03"))
    command = [sys.executable, "tools/frame_header.py"]
    done = subprocess.run([*command, "--check"], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 1
    assert "run python tools/frame_header.py" in done.stderr
    assert subprocess.run(command, cwd=tmp_path).returncode == 0
    assert subprocess.run([*command, "--check"], cwd=tmp_path).returncode == 0


def test_offsets_in_a_command() -> None:
    protocol = FrameProtocol(find_preset("firmware_stub/frames", "uuv_hil"))
    data = protocol.encode(ThrusterCommand(0x1234, True, PULSES))
    assert len(data) == value("COMMAND_FRAME_SIZE")
    assert data[:2] == bytes([value("SYNC_0"), value("SYNC_1")])
    assert data[value("LENGTH")] == value("COMMAND_PAYLOAD_SIZE")
    assert data[value("ID")] == value("COMMAND_ID")
    assert int.from_bytes(data[value("COMMAND_SEQUENCE") :][:2], "little") == 0x1234
    assert data[value("COMMAND_FLAGS")] == value("COMMAND_ARMED")
    assert data[value("COMMAND_COUNT")] == len(PULSES)
    size, start = value("COMMAND_PWM_US_SIZE"), value("COMMAND_PWM_US")
    assert tuple(int.from_bytes(data[start + size * i :][:size], "little") for i in range(3)) == PULSES
    assert value("COMMAND_CRC") + value("CRC_SIZE") == len(data)
    assert len(protocol.encode(ThrusterCommand(0, True, (1500,) * 16))) == value("COMMAND_FRAME_SIZE_MAX")


def test_offsets_in_a_report() -> None:
    protocol = FrameProtocol(find_preset("firmware_stub/frames", "uuv_hil"))
    data = protocol.encode(ThrusterTelemetry(0x1234, False, True, PULSES, 0x01020304, 0x0506, 0x0708, 0x090A))
    numbers = {"SEQUENCE": 0x1234, "AGE_US": 0x01020304, "FRAMES": 0x0506, "ERRORS": 0x0708, "WATCHDOG_TRIPS": 0x090A}
    for name, wanted in numbers.items():
        start, size = value(f"TELEMETRY_{name}"), value(f"TELEMETRY_{name}_SIZE")
        assert int.from_bytes(data[start : start + size], "little") == wanted, name
    assert data[value("TELEMETRY_FLAGS")] == value("TELEMETRY_TIMED_OUT")
    assert data[value("TELEMETRY_PWM_US") :][:2] == PULSES[0].to_bytes(2, "little")
    assert len(data) == value("TELEMETRY_FRAME_SIZE")
