"""Measure how many slaves this machine and its routers carry: `python -m tools.costs.scale` prints a table.

N slaves run on this machine and dial a router; a client behind the same router, or behind a second one joined with it,
listens to the state of each for some seconds. Rates and ages depend on what else the machine does; memory does not.

"lost" is the share of the samples, from a vehicle's first to its last by their stamps, that did not arrive: those that
the network dropped, and those that a late slave skipped. "age" is the time from publish to receipt.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from math import nan
from pathlib import Path
from typing import NamedTuple

import psutil

from hil.client.client import Stamped, VehicleClient
from hil.common.children import module_command, package_environment, start_child
from hil.common.clock import NS_PER_MS, NS_PER_S
from hil.common.ports import free_ports
from hil.common.quantiles import quantile
from hil.network.roles import open_master_session
from hil.network.settings import Network

HEADER = (
    "| slaves | routers | sessions | found | state, Hz each | lost, % | age 50 %, ms | age 99 %, ms | CPU a slave, % |"
    " CPU a router, % | RSS a slave, MiB | RSS a router, MiB |"
)
SCENARIO = """\
vehicle = "paper_six"
world = "paper_field"
[slave]
node = "uuv{number}"
realtime = false
step = "{step} ms"
stay_awake = false
[network]
mode = "routed"
router = "{router}"
[master]
goal = [2.0, 2.0]
depth = "1 m"
"""
TOPICS = ("odom",)
PERIOD_NS = NS_PER_S // 20  # of odometry
TOGETHER = 4  # slaves that start at once: all at once would take the processor from each other
LESS_URGENT = 5  # by which a slave is nicer than a router: on boards of their own they do not share a processor
START_WITHIN_S = 30.0


class Received:
    """The state messages of one vehicle: their stamps in simulation time (ns), and their ages (ms)."""

    def __init__(self) -> None:
        self.stamps: list[int] = []
        self.ages: list[float] = []

    def add(self, topic: str, sample: Stamped) -> None:
        """Count a message, in the network's thread."""
        if topic in TOPICS:
            self.stamps.append(sample.value.time_ns)
            self.ages.append((sample.received_ns - sample.sent_ns) / NS_PER_MS)

    def clear(self) -> None:
        """Count from here on. A message that comes meanwhile is counted or not."""
        self.stamps, self.ages = [], []

    def sent(self) -> int:
        """Return how many there were from the first to the last that came."""
        return round((self.stamps[-1] - self.stamps[0]) / PERIOD_NS) + 1 if self.stamps else 0


class Use(NamedTuple):
    """Processor time (s) and resident bytes of each process so far."""

    cpu: list[float]
    resident: list[int]


def measure(slaves: int, routers: int, seconds: float, sessions: str, step: float) -> str:
    """Return a row of the table; `step` of the slaves in ms. Raises HilError when a slave cannot be reached."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        ends = [f"tcp/127.0.0.1:{port}" for port in free_ports(routers)]
        processes = [start(stack, ["router", "--listen", end, *_joined(ends, end)]) for end in ends]
        network = Network(mode="routed", router=ends[-1])
        shared = stack.enter_context(open_master_session(ends[-1], network=network)) if sessions == "one" else ends[-1]
        received = [Received() for _ in range(slaves)]
        for number, port in enumerate(free_ports(slaves)):
            own = received[number]
            client = VehicleClient(
                shared, f"uuv{number}", part="observer", network=network, topics=TOPICS, on_sample=own.add
            )
            stack.enter_context(client)
            path = folder / f"{number}.toml"
            path.write_text(SCENARIO.format(number=number, router=ends[0], step=step), encoding="utf-8")
            processes.append(start(stack, ["slave", str(path), "--listen", f"tcp/127.0.0.1:{port}"]))
            processes[-1].nice(processes[-1].nice() + LESS_URGENT)
            if (number + 1) % TOGETHER == 0 or number + 1 == slaves:
                _wait_for(partial(_all_found, received[: number + 1]))
        for own in received:
            own.clear()
        first, begun = use(processes), time.monotonic()
        time.sleep(seconds)
        last, took = use(processes), time.monotonic() - begun
        for process in processes:  # clients close at once when nobody is there: else it takes minutes
            process.kill()
    cpu = [100.0 * (b - a) / took for a, b in zip(first.cpu, last.cpu, strict=True)]
    ages = sorted(age for own in received for age in own.ages)
    sent = sum(own.sent() for own in received)
    figures = (
        len(ages) / took / slaves, 100.0 * (1.0 - len(ages) / sent) if sent else nan,
        quantile(ages, 0.5), quantile(ages, 0.99), sum(cpu[routers:]) / slaves, sum(cpu[:routers]) / routers,
        sum(last.resident[routers:]) / slaves / 2**20, sum(last.resident[:routers]) / routers / 2**20,
    )  # fmt: skip
    alive = sum(bool(own.stamps) for own in received)
    return f"| {slaves} | {routers} | {sessions} | {alive} | " + " | ".join(f"{value:.1f}" for value in figures) + " |"


def _all_found(received: list[Received]) -> bool:
    return all(own.stamps for own in received)


def _wait_for(condition: Callable[[], bool]) -> None:
    """Wait for it, at most `START_WITHIN_S`."""
    end = time.monotonic() + START_WITHIN_S
    while time.monotonic() < end and not condition():
        time.sleep(0.2)


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


def use(processes: list[psutil.Process]) -> Use:
    """Return what has been used so far."""
    times = [process.cpu_times() for process in processes]
    return Use([each.user + each.system for each in times], [process.memory_info().rss for process in processes])


def main(arguments: list[str]) -> int:
    """Measure and print; the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, prog="python -m tools.costs.scale")
    parser.add_argument("--slaves", type=int, nargs="+", default=[1, 2, 4, 8, 16, 32, 64])
    parser.add_argument("--routers", type=int, nargs="+", choices=(1, 2), default=[1, 2])
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument(
        "--sessions", choices=("one", "each"), default="one", help="of the observer: one, or one each vehicle"
    )
    parser.add_argument("--step", type=float, default=2.5, help="of the slaves, in ms [%(default)s]")
    options = parser.parse_args(arguments)
    load = os.getloadavg()[0]
    print(f"{os.cpu_count()} processors, load before: {load:.1f}\n\n{HEADER}\n|{'---|' * HEADER.count(' | ')}---|")
    for routers in options.routers:
        for slaves in options.slaves:
            print(measure(slaves, routers, options.seconds, options.sessions, options.step), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
