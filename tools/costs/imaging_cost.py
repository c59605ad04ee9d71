"""Measure what imaging sensors cost a slave's loop, and how many pictures a large camera gives beside sonars.

    python tools/costs/imaging_cost.py [--seconds 60] [--rounds 3]
    python tools/costs/imaging_cost.py --large [--seconds 60] [--rounds 3] [--renderer opengl] [--world ridge]

The first form runs the same slave in turn without and with a camera (320 x 240 with depth) and a forward-looking sonar
(512 beams), each ten times a second, while a master on the same machine commands it and receives every picture. The
loop's lateness at 99.9 % with them may be at most 1.5 times that without, by the medians of the rounds; otherwise the
exit code is 1.

With `--large` a camera of 640 x 480 (JPEG) has to make 15 pictures a second, beside a forward-looking and a side-scan
sonar with default settings, and one master receives all of them. The loop's lateness without them is printed too. Exit
code 1 if fewer than 14.5 pictures a second arrive, by the median of the rounds.

The first seconds of a slave count too. Run nothing else meanwhile, and compile bytecode first. `taskset -c 0,1` before
the command limits it to two cores.
"""

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from hil.autonomy.control.controller import VelocityCommand  # noqa: E402 - works from a bare checkout too
from hil.client.client import VehicleClient  # noqa: E402
from hil.client.delay import quantiles  # noqa: E402
from hil.common.children import module_command, package_environment, start_child  # noqa: E402
from hil.ros.diagnostics import or_nan  # noqa: E402

MAX = 1.5
MIN_HZ = 14.5
PORT = 20_000 + 2 * (os.getpid() % 5000)
FIRST_S = 30.0  # limit until all pictures arrive
PICTURES = ("camera/image_raw", "camera/depth/image_raw", "forward_sonar/image")
SONARS = ("forward_sonar/image", "side_scan/image")
SLAVE = f"""
vehicle = "bluerov2_heavy"
world = "WORLD"
[start]
depth = 5
[slave]
listen = "tcp/127.0.0.1:{PORT}"
[master]
goal = [40, 40]
depth = 5
"""
TILTED = 'orientation = ["0 deg", "-30 deg", "0 deg"]'
SENSORS = f"""
[ros]
images = "raw"
[sensors.camera]
rate = 10
{TILTED}
[sensors.forward_sonar]
rate = 10
orientation = ["0 deg", "-15 deg", "0 deg"]
"""
LARGE = f"""
[sensors.camera]
rate = 15
width = 640
height = 480
renderer = "RENDERER"
{TILTED}
[sensors.forward_sonar]
orientation = ["0 deg", "-15 deg", "0 deg"]
[sensors.side_scan]
"""


class Setting(NamedTuple):
    """Sensors that are fitted, and the topics that the master takes; the first one is the camera's."""

    scenario: str
    topics: tuple[str, ...]


class Cost(NamedTuple):
    """One run: lateness (us) at 50, 99 and 99.9 % from its start, delay of commands (ms) at 50 and 99 %.

    Once all pictures come, the messages a second of each topic, how many requests were dropped, and the cores' time
    that imaging, the rest of the slave, and the master take.
    """

    p50_us: float
    p99_us: float
    p999_us: float
    delay_p50_ms: float
    delay_p99_ms: float
    rates_hz: tuple[float, ...]
    dropped: float
    cores: tuple[float, float, float]

    def text(self, label: str) -> str:
        """Return a line of the table."""
        rates = " ".join(f"{rate:6.1f}" for rate in self.rates_hz)
        imaging, slave, master = self.cores
        return (
            f"{label:8} {self.p50_us:9.0f} {self.p99_us:6.0f} {self.p999_us:7.0f} {self.delay_p50_ms:12.2f} "
            f"{self.delay_p99_ms:6.2f} {self.dropped:9.0f} {imaging:10.2f} {slave:7.3f} {master:7.3f}   {rates}"
        )


class Counted(NamedTuple):
    """Counts at an instant: seconds, messages by topic, drops, and processor times (s) as in Cost."""

    time_s: float
    messages: tuple[int, ...]
    dropped: float
    cpu_s: tuple[float, float, float]


HEAD = (
    "          late us: 50 %   99 %  99.9 %  command ms: 50 %   99 %  dropped  cores: imaging  slave  master   "
    "messages a second by topic"
)


def run(setting: Setting, seconds: float) -> Cost:
    """Measure one slave for `seconds`."""
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "cost.toml")
        Path(path).write_text(setting.scenario, encoding="utf-8")
        command = module_command("hil.cli", "slave", path)
        with start_child(command, environment=package_environment(), stderr=subprocess.DEVNULL) as slave:
            try:
                return _fly(setting.topics, seconds)
            finally:
                slave.terminate()


def _fly(topics: Sequence[str], seconds: float) -> Cost:
    with VehicleClient(f"tcp/127.0.0.1:{PORT}", "uuv1") as client:
        client.watch(*topics)
        if not client.wait_for_vehicle(20.0):
            sys.exit("the slave did not come")
        begun = time.monotonic()
        while time.monotonic() < begun + FIRST_S and not all(client.received[topic] for topic in topics):
            _command(client)
        first = _count(client, topics)
        while time.monotonic() < first.time_s + seconds:
            _command(client)
        last, figures = _count(client, topics), client.diagnostics()
        if not figures:
            sys.exit("the slave has reported no figures: this machine has too much else to do")
        p50, p99, p999 = [or_nan(figures[f"lateness_{name}_us"]) for name in ("p50", "p99", "p999")]
        delay, took = quantiles(client.delays.totals_ns()), last.time_s - first.time_s
        rates = tuple((now - then) / took for now, then in zip(last.messages, first.messages, strict=True))
        imaging, slave, master = ((now - then) / took for now, then in zip(last.cpu_s, first.cpu_s, strict=True))
        cores = imaging, slave, master
        dropped = last.dropped - first.dropped
        return Cost(p50, p99, p999, delay.p50_ms, delay.p99_ms, rates, dropped, cores)


def _command(client: VehicleClient) -> None:
    client.command(VelocityCommand(surge=0.3, yaw_rate=0.1))
    time.sleep(0.05)


def _count(client: VehicleClient, topics: Sequence[str]) -> Counted:
    figures = client.diagnostics()
    imaging = figures.imaging_cpu_s or 0.0
    cpu_s = imaging, (figures.cpu_s or 0.0) - imaging, time.process_time()
    dropped = sum((figures.imaging_dropped or {}).values())
    return Counted(time.monotonic(), tuple(client.received[topic] for topic in topics), dropped, cpu_s)


def main() -> int:
    """Measure and print; return 1 if the loop is too late, or too few pictures arrive."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0, help="of each run [%(default)g]")
    parser.add_argument("--rounds", type=int, default=3, help="[%(default)s]")
    parser.add_argument("--large", action="store_true", help="a camera of 640 x 480 at 15 Hz beside sonars")
    parser.add_argument("--renderer", choices=("rays", "opengl"), default="rays", help="of the large [%(default)s]")
    parser.add_argument("--world", default="ridge", help="of the large [%(default)s]")
    options = parser.parse_args()
    settings = {"without": Setting(SLAVE.replace("WORLD", options.world), ())}
    if options.large:
        sensors = LARGE.replace("RENDERER", options.renderer)
        settings["large"] = Setting(settings["without"].scenario + sensors, ("camera/image_raw/compressed", *SONARS))
    else:
        settings["with"] = Setting(settings["without"].scenario + SENSORS, PICTURES)
    costs: dict[str, list[Cost]] = {label: [] for label in settings}
    print(HEAD)
    for _ in range(options.rounds):
        for label, setting in settings.items():
            costs[label].append(run(setting, options.seconds))
            print(costs[label][-1].text(label), flush=True)
    late = {label: statistics.median(cost.p999_us for cost in of) for label, of in costs.items()}
    cores = len(os.sched_getaffinity(0))
    if options.large:
        rate = statistics.median(cost.rates_hz[0] for cost in costs["large"])
        print(f"{rate:.1f} large pictures a second, at least {MIN_HZ}; {cores} cores")
        return int(rate < MIN_HZ)
    ratio = late["with"] / late["without"]
    print(f"late at 99.9 %, with to without: {ratio:.2f}, budget {MAX}; {cores} cores")
    return int(ratio > MAX)


if __name__ == "__main__":
    sys.exit(main())
