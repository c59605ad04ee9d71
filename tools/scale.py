"""Measure how many slaves this machine and its routers carry: `python -m tools.scale`, which prints a Markdown table.

N slaves run on this machine and dial a router; a client behind the same router, or behind a second one joined with it,
listens to the state of each for some seconds. Rates depend on what else the machine does; memory does not.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

import psutil

from hil.client.client import VehicleClient
from hil.common.children import module_command, package_environment, start_child
from hil.common.ports import free_ports
from hil.network.roles import open_master_session
from hil.network.settings import Network

HEADER = (
    "| slaves | routers | found | state, Hz each | CPU a slave, % | CPU a router, % | RSS a slave, MiB |"
    " RSS a router, MiB |"
)
SCENARIO = """\
vehicle = "paper_six"
world = "paper_field"
[slave]
node = "uuv{number}"
realtime = false
stay_awake = false
[network]
mode = "routed"
router = "{router}"
[master]
goal = [2.0, 2.0]
depth = "1 m"
"""
TOPICS = ("odom",)


class Use(NamedTuple):
    """What has been used so far: state messages of each slave, CPU s and resident bytes of each process."""

    received: list[int]
    cpu: list[float]
    resident: list[int]


def measure(slaves: int, routers: int, seconds: float, sessions: str) -> str:
    """Return a row of the table. Raises HilError when a slave cannot be reached."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        ends = [f"tcp/127.0.0.1:{port}" for port in free_ports(routers)]
        commands = [["router", "--listen", end, *_joined(ends, end)] for end in ends]
        for number, port in enumerate(free_ports(slaves)):
            path = folder / f"{number}.toml"
            path.write_text(SCENARIO.format(number=number, router=ends[0]), encoding="utf-8")
            commands.append(["slave", str(path), "--listen", f"tcp/127.0.0.1:{port}"])
        processes = [start(stack, words) for words in commands]
        network = Network(mode="routed", router=ends[-1])
        shared = stack.enter_context(open_master_session(ends[-1], network=network)) if sessions == "one" else ends[-1]
        clients = [
            stack.enter_context(VehicleClient(shared, f"uuv{n}", part="observer", network=network, topics=TOPICS))
            for n in range(slaves)
        ]
        end = time.monotonic() + 20.0 + slaves
        while time.monotonic() < end and not all(client.received["odom"] for client in clients):
            time.sleep(0.2)
        first, begun = use(clients, processes), time.monotonic()
        time.sleep(seconds)
        last, took = use(clients, processes), time.monotonic() - begun
    cpu = [100.0 * (b - a) / took for a, b in zip(first.cpu, last.cpu, strict=True)]
    gained = [b - a for a, b in zip(first.received, last.received, strict=True)]
    figures = (
        sum(gained) / took / slaves, sum(cpu[routers:]) / slaves, sum(cpu[:routers]) / routers,
        sum(last.resident[routers:]) / slaves / 2**20, sum(last.resident[:routers]) / routers / 2**20,
    )  # fmt: skip
    found = sum(count > 0 for count in gained)
    return f"| {slaves} | {routers} | {found} | " + " | ".join(f"{figure:.1f}" for figure in figures) + " |"


def _joined(ends: list[str], end: str) -> list[str]:
    """Return the options with which a router dials the first."""
    return ["--connect", ends[0]] if end != ends[0] else []


def start(stack: ExitStack, words: list[str]) -> psutil.Process:
    """Return a command of ours as a process, which ends with the stack."""
    quiet = subprocess.DEVNULL
    child = start_child(module_command("hil", *words), environment=package_environment(), stdout=quiet, stderr=quiet)
    stack.callback(child.wait)
    stack.callback(child.kill)  # many that end in good order at once take minutes
    return psutil.Process(child.pid)


def use(clients: list[VehicleClient], processes: list[psutil.Process]) -> Use:
    """Return what has been used so far."""
    times = [process.cpu_times() for process in processes]
    return Use(
        [client.received["odom"] for client in clients],
        [time.user + time.system for time in times],
        [process.memory_info().rss for process in processes],
    )


def main(arguments: list[str]) -> int:
    """Measure and print; the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, prog="python -m tools.scale")
    parser.add_argument("--slaves", type=int, nargs="+", default=[1, 2, 4, 8, 16, 32, 64])
    parser.add_argument("--routers", type=int, nargs="+", choices=(1, 2), default=[1, 2])
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument(
        "--sessions", choices=("one", "each"), default="one", help="of the observer: one, or one each vehicle"
    )
    options = parser.parse_args(arguments)
    load = os.getloadavg()[0]
    print(f"{os.cpu_count()} processors, load before: {load:.1f}\n\n{HEADER}\n|{'---|' * HEADER.count(' | ')}---|")
    for routers in options.routers:
        for slaves in options.slaves:
            print(measure(slaves, routers, options.seconds, options.sessions), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
