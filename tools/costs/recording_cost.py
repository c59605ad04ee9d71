"""Measure the cost of recording ten commanded slaves with every sensor there is for a minute.

    python tools/costs/recording_cost.py [--vehicles 10] [--seconds 60]

Every message must be recorded, by the sequence numbers of its publisher, and the recorder must take at most a tenth of
a core. The slaves run in real time: if the machine is too slow for them, `real time` shows it, and the figures do not
count.
Exit code 1 when a budget is missed.
"""

import argparse
import re
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from hil.autonomy.control.controller import VelocityCommand  # noqa: E402 - works from a bare checkout too
from hil.bench.processes import cpu_s  # noqa: E402
from hil.client.client import VehicleClient  # noqa: E402
from hil.common.children import module_command, package_environment, start_child  # noqa: E402
from hil.recording.reader import read_messages  # noqa: E402
from hil.ros.diagnostics import or_nan  # noqa: E402

MAX_OF_A_CORE = 0.10
FIRST_PORT = 21000
SENSORS = ("ahrs", "altimeter", "contact", "current_meter", "dvl_water", "leak", "magnetometer", "usbl")
SCENARIO = """
vehicle = "paper_six"
world = "pool"
[start]
depth = 2
[slave]
node = "uuv{number}"
listen = "tcp/127.0.0.1:{port}"
realtime = false
{sensors}
[master]
goal = [8, 7]
"""


def start(folder: Path, number: int) -> subprocess.Popen[bytes]:
    """Start one slave and return it."""
    path = folder / f"{number}.toml"
    sensors = "".join(f"[sensors.{name}]\n" for name in SENSORS)
    path.write_text(SCENARIO.format(number=number, port=FIRST_PORT + 2 * number, sensors=sensors), encoding="utf-8")
    command = module_command("hil.cli", "slave", str(path))
    return start_child(command, environment=package_environment(), stderr=subprocess.DEVNULL)


def fly(clients: list[VehicleClient], seconds: float) -> None:
    """Command all of them 20 times a second."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        for client in clients:
            client.command(VelocityCommand(surge=0.2, yaw_rate=0.3))
        time.sleep(0.05)


def gaps(folder: Path) -> tuple[int, int]:
    """Return the messages recorded, and those missing between the first and the last of each topic."""
    numbers: dict[str, list[int]] = defaultdict(list)
    for message in read_messages(str(folder)):
        numbers[message.topic if not message.topic.startswith("/clock") else ""].append(message.sequence)
    numbers.pop("", None)
    shared = ("/tf", "/tf_static")  # ten publishers on one topic
    for topic in shared:
        numbers.pop(topic, None)
    total = sum(map(len, numbers.values()))
    return total, sum(max(each) - min(each) + 1 - len(each) for each in numbers.values())


def main() -> int:
    """Measure; return 1 when a budget is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vehicles", type=int, default=10)
    parser.add_argument("--seconds", type=float, default=60.0)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        slaves = [start(folder, number) for number in range(options.vehicles)]
        endpoints = [f"tcp/127.0.0.1:{FIRST_PORT + 2 * number}" for number in range(options.vehicles)]
        clients = [VehicleClient(endpoint, f"uuv{number}") for number, endpoint in enumerate(endpoints)]
        try:
            if not all(client.wait_for_vehicle(30) for client in clients):
                print("a slave did not start")
                return 1
            connect = [word for endpoint in endpoints for word in ("--connect", endpoint)]
            out = folder / "recording"
            words = module_command("hil.cli", "record", *connect, "-o", str(out), "--seconds", str(options.seconds))
            recorder = start_child(words, environment=package_environment(), stdout=subprocess.PIPE, text=True)
            fly(clients, 3.0)  # it has started
            before, began = cpu_s([recorder.pid]), time.monotonic()
            fly(clients, options.seconds - 6.0)
            share = (cpu_s([recorder.pid]) - before) / (time.monotonic() - began)
            fly(clients, 2.0)
            output = recorder.communicate()[0]
            real_time = min(or_nan(client.diagnostics().real_time_factor) for client in clients)
        finally:
            for client in clients:
                client.close()
            for slave in slaves:
                slave.terminate()
                slave.wait()
        total, missing = gaps(out)
        size = sum(entry.stat().st_size for entry in out.iterdir())
    print(output.strip().splitlines()[-1])
    print(
        f"{total} messages of {options.vehicles} vehicles, {total / options.seconds:.0f} a second, {missing} missing; "
        f"{share:.1%} of a core; {size / options.seconds / 1e3:.0f} kB/s; real time x{real_time:.3f}"
    )
    lossless = missing == 0 and re.search("none lost", output) is not None
    return 0 if lossless and share <= MAX_OF_A_CORE else 1


if __name__ == "__main__":
    sys.exit(main())
