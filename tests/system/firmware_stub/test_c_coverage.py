"""Every line of the portable core in C is run by a test, under sanitizers."""

import json
import os
import subprocess

from firmware_stub import build
from hil.links.contract import ThrusterTelemetry
from tests.support.firmware.c_core import Script, Step, frame_script, run_c
from tests.support.firmware.c_mavlink import mavlink_script
from tests.support.firmware.c_vesc import vesc_script
from tests.support.links.link_contract import uuv_hil

PORTABLE = {
    "board.c",
    "stream.c",
    "frame.c",
    "firmware.c",
    "mavlink.c",
    "vesc.c",
}


def test_every_line_of_the_core_is_run(core: str) -> None:
    for seed in range(3):
        run_c(core, frame_script(seed, 200, noisy=True), stop=True)
        run_c(core, mavlink_script(seed, 400), stop=True)
        run_c(core, vesc_script(seed, 300), stop=True)
    report = ThrusterTelemetry(1, True, True, (1500,), 0, 0, 0, 0)
    run_c(core, Script(1, 200_000, [Step(0, uuv_hil().encode(report))]))
    unrun = {name: [line for line, count in lines.items() if not count] for name, lines in coverage(core).items()}
    assert unrun == {name: [] for name in PORTABLE}


def coverage(core: str) -> dict[str, dict[int, int]]:
    """Return how often each line of each portable file was run so far."""
    folder = os.path.dirname(core)
    data = [os.path.join(folder, name) for name in os.listdir(folder) if name.endswith(".gcda")]
    done = subprocess.run(["gcov", "--json-format", "--stdout", *data], capture_output=True, check=True, cwd=folder)
    counts: dict[str, dict[int, int]] = {}
    for line in done.stdout.splitlines():
        for file in json.loads(line)["files"]:
            if os.path.dirname(file["file"]) == os.path.join(build.HERE, "src"):
                lines = {row["line_number"]: row["count"] for row in file["lines"]}
                counts[os.path.basename(file["file"])] = lines
    return counts
