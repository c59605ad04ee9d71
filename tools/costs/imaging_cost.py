"""Measure the cost of a camera and a sonar for the slave's loop: its lateness and the delay of commands.

    python tools/costs/imaging_cost.py [--seconds 60] [--rounds 3]

The same slave in turn without and with a camera (320 x 240 with depth) and a forward-looking sonar (512 beams), each
ten times a second, while a master of the same machine commands it and takes every picture. The loop's lateness at
99.9 % may be at most 1.5 times that without, by the medians of the rounds; exit code 1 when it is more. The first
seconds of a slave count too. Leave the machine alone meanwhile, and compile bytecode first.
"""

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from hil.autonomy.control.controller import VelocityCommand  # noqa: E402 - works from a bare checkout too
from hil.client.client import VehicleClient  # noqa: E402
from hil.client.delay import quantiles  # noqa: E402
from hil.common.children import module_command, package_environment, start_child  # noqa: E402
from hil.ros.diagnostics import or_nan  # noqa: E402

MOST = 1.5
PORT = 20_000 + 2 * (os.getpid() % 5000)
PICTURES = ("camera/image_raw", "camera/depth/image_raw", "forward_sonar/image")
SCENARIO = f"""
vehicle = "bluerov2_heavy"
world = "ridge"
[start]
depth = 5
[slave]
listen = "tcp/127.0.0.1:{PORT}"
[ros]
images = "raw"
[master]
goal = [40, 40]
depth = 5
"""
SENSORS = """
[sensors.camera]
rate = 10
orientation = ["0 deg", "-30 deg", "0 deg"]
[sensors.forward_sonar]
rate = 10
orientation = ["0 deg", "-15 deg", "0 deg"]
"""


class Cost(NamedTuple):
    """One run: lateness (us) at 50, 99 and 99.9 %, delay of commands (ms) at 50 and 99 %, pictures a second, CPU."""

    p50_us: float
    p99_us: float
    p999_us: float
    delay_p50_ms: float
    delay_p99_ms: float
    pictures_hz: float
    dropped: float
    imaging_cores: float


def run(pictures: bool, seconds: float) -> Cost:
    """One slave for so long."""
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "cost.toml")
        Path(path).write_text(SCENARIO + (SENSORS if pictures else ""), encoding="utf-8")
        command = module_command("hil.cli", "slave", path)
        with start_child(command, environment=package_environment(), stderr=subprocess.DEVNULL) as slave:
            try:
                return _fly(seconds)
            finally:
                slave.terminate()


def _fly(seconds: float) -> Cost:
    with VehicleClient(f"tcp/127.0.0.1:{PORT}", "uuv1") as client:
        client.watch(*PICTURES)
        if not client.wait_for_vehicle(20.0):
            sys.exit("the slave did not come")
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            client.command(VelocityCommand(surge=0.3, yaw_rate=0.1))
            time.sleep(0.05)
        figures = client.diagnostics()
        if not figures:
            sys.exit("the slave has told no figures: this machine has too much else to do")
        late = [or_nan(figures[f"lateness_{name}_us"]) for name in ("p50", "p99", "p999")]
        delay = quantiles(client.delays.totals_ns())
        shown = sum(client.received[topic] for topic in PICTURES) / seconds
        dropped = sum((figures.imaging_dropped or {}).values())
        cpu = (figures.imaging_cpu_s or 0.0) / seconds
        return Cost(late[0], late[1], late[2], delay.p50_ms, delay.p99_ms, shown, dropped, cpu)


def main() -> int:
    """Measure and print; 1 when the loop is later than it may be."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0, help="of each run [%(default)g]")
    parser.add_argument("--rounds", type=int, default=3, help="[%(default)s]")
    options = parser.parse_args()
    costs: dict[bool, list[Cost]] = {False: [], True: []}
    print("              late us: 50 %   99 %  99.9 %   command ms: 50 %  99 %   pictures/s  dropped  imaging cores")
    for _ in range(options.rounds):
        for pictures in (False, True):
            cost = run(pictures, options.seconds)
            costs[pictures].append(cost)
            label = "with" if pictures else "without"
            print(
                f"{label:8} {cost.p50_us:18.0f} {cost.p99_us:6.0f} {cost.p999_us:7.0f} {cost.delay_p50_ms:18.2f} "
                f"{cost.delay_p99_ms:5.2f} {cost.pictures_hz:12.1f} {cost.dropped:8} {cost.imaging_cores:14.2f}",
                flush=True,
            )
    without, with_pictures = (statistics.median(cost.p999_us for cost in costs[pictures]) for pictures in (False, True))
    ratio = with_pictures / without
    print(f"late at 99.9 %, with to without: {ratio:.2f}, budget {MOST}; {os.cpu_count()} cores")
    return int(ratio > MOST)


if __name__ == "__main__":
    sys.exit(main())
