"""Measure how many slaves this machine and its routers carry: `python -m tools.costs.scale` prints a table.

N slaves run on this machine and connect to a router; a client behind the same router, or behind a second one joined
with it, listens to the state of each for some seconds. Rates and ages depend on what else the machine does; memory does
not.

"lost" is the share of the samples, from a vehicle's first to its last by their stamps, that did not arrive: those that
the network dropped, and those that a late slave skipped. "age" is the time from publish to receipt.

A run in which not all slaves are found, or that does not end, is a row of a second table. Each run is a separate
process, which is killed at the limit with all that it started. All of them have a lower priority than your shell.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import partial
from math import nan
from pathlib import Path
from typing import NamedTuple

import psutil

from hil.client.client import Stamped, VehicleClient
from hil.common.children import finish_child, module_command, package_environment, start_child
from hil.common.clock import NS_PER_MS, NS_PER_S
from hil.common.errors import HilError
from hil.common.lifeline import die_with_parent
from hil.common.ports import free_ports
from hil.common.quantiles import quantile
from hil.network.roles import open_master_session
from hil.network.settings import Network

HEADER = (
    "| slaves | routers | sessions | found | state, Hz each | lost, % | age 50 %, ms | age 99 %, ms | CPU a slave, % |"
    " CPU a router, % | RSS a slave, MiB | RSS a router, MiB |"
)
BROKEN = "| slaves | routers | step | result |"
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
LESS_URGENT = 5  # nice value of slaves above a router's: on boards of their own they do not share a processor
START_WITHIN_S = 60.0  # for a group; when it takes longer, no more are started


class Received:
    """The state messages of one vehicle: their stamps in simulation time (ns), and their ages (ms)."""

    def __init__(self) -> None:
        self.stamps: list[int] = []
        self.ages: list[float] = []
        self.has_begun = False

    def add(self, topic: str, sample: Stamped) -> None:
        """Count a message, in the network's thread."""
        if topic in TOPICS:
            self.has_begun = True
            self.stamps.append(sample.value.time_ns)
            self.ages.append((sample.received_ns - sample.sent_ns) / NS_PER_MS)

    def clear(self) -> None:
        """Reset the count. A message that arrives meanwhile is counted or not."""
        self.stamps, self.ages = [], []

    def sent(self) -> int:
        """Return the number of messages sent from the first to the last received."""
        return round((self.stamps[-1] - self.stamps[0]) / PERIOD_NS) + 1 if self.stamps else 0


class Use(NamedTuple):
    """Processor time (s) and resident bytes of each process so far."""

    cpu: list[float]
    resident: list[int]


def measure(
    stack: ExitStack, folder: Path, slaves: int, routers: int, seconds: float, sessions: str, step: float
) -> str:
    """Return a row of the table, or of that of `BROKEN` when not all slaves are found; `step` of the slaves in ms.

    All processes have ended then; `stack` closes the rest, which may take minutes. `folder`: for scenarios.
    """
    received = [Received() for _ in range(slaves)]
    processes: list[psutil.Process] = []
    began = time.monotonic()
    try:
        _start_all(stack, folder, processes, received, routers, sessions, step)
        for own in received:
            own.clear()
        first, begun = use(processes), time.monotonic()
        time.sleep(seconds)
        last, span = use(processes), time.monotonic() - begun
    except (HilError, psutil.Error) as error:
        return _broken(received, routers, step, f"then {str(error).splitlines()[0]}")
    finally:
        for process in processes:  # without peers clients close at once, otherwise it takes minutes
            process.kill()
    active = [own for own in received if own.stamps]
    ages = sorted(age for own in active for age in own.ages)
    if len(active) < slaves:
        rate = f"{len(active)} were found, {len(ages) / span / len(active):.1f} Hz each" if active else ""
        none = f"none was found any more after {begun + span - began:.0f} s"
        return _broken(received, routers, step, rate or none)
    cpu = [100.0 * (b - a) / span for a, b in zip(first.cpu, last.cpu, strict=True)]
    sent = sum(own.sent() for own in active)
    figures = (
        len(ages) / span / slaves, 100.0 * (1.0 - len(ages) / sent) if sent else nan,
        quantile(ages, 0.5), quantile(ages, 0.99), sum(cpu[routers:]) / slaves, sum(cpu[:routers]) / routers,
        sum(last.resident[routers:]) / slaves / 2**20, sum(last.resident[:routers]) / routers / 2**20,
    )  # fmt: skip
    cells = " | ".join(f"{value:.1f}" for value in figures)
    return f"| {slaves} | {routers} | {sessions} | {len(active)} | {cells} |"


def _broken(received: Sequence[Received], routers: int, step: float, result: str) -> str:
    """Return the row of a failed run: the number of slaves that started, and the result."""
    begun = sum(own.has_begun for own in received)
    began = "all" if begun == len(received) else str(begun)
    return f"| {len(received)} | {routers} | {step:g} ms | {began} began, {result} |"


def _start_all(
    stack: ExitStack,
    folder: Path,
    processes: list[psutil.Process],
    received: Sequence[Received],
    routers: int,
    sessions: str,
    step: float,
) -> None:
    """Start routers and slaves, which are appended to `processes`, and subscribe. Raises HilError, psutil.Error.

    No more slaves are started when a group is not found in time.
    """
    ends = [f"tcp/127.0.0.1:{port}" for port in free_ports(routers)]
    processes += [start(stack, ["router", "--listen", end, *_joined(ends, end)]) for end in ends]
    network = Network(mode="routed", router=ends[-1])
    shared = stack.enter_context(open_master_session(ends[-1], network=network)) if sessions == "one" else ends[-1]
    for number, port in enumerate(free_ports(len(received))):
        own = received[number]
        client = VehicleClient(
            shared, f"uuv{number}", role="observer", network=network, topics=TOPICS, on_sample=own.add
        )
        stack.enter_context(client)
        path = folder / f"{number}.toml"
        path.write_text(SCENARIO.format(number=number, router=ends[0], step=step), encoding="utf-8")
        processes.append(start(stack, ["slave", str(path), "--listen", f"tcp/127.0.0.1:{port}"]))
        processes[-1].nice(processes[-1].nice() + LESS_URGENT)
        is_last = (number + 1) % TOGETHER == 0 or number + 1 == len(received)
        if is_last and not _wait_for(partial(_all_found, received[: number + 1])):
            return


def _all_found(received: Sequence[Received]) -> bool:
    return all(own.has_begun for own in received)


def _wait_for(condition: Callable[[], bool]) -> bool:
    """Wait for the condition, at most `START_WITHIN_S`; return whether it holds."""
    end = time.monotonic() + START_WITHIN_S
    while time.monotonic() < end and not condition():
        time.sleep(0.2)
    return condition()


def _joined(ends: list[str], end: str) -> list[str]:
    """Return the options with which a router connects to the first."""
    return ["--connect", ends[0]] if end != ends[0] else []


def start(stack: ExitStack, words: list[str]) -> psutil.Process:
    """Return a command of ours as a process, which ends with the stack."""
    quiet = subprocess.DEVNULL
    child = start_child(module_command("hil", *words), environment=package_environment(), stdout=quiet, stderr=quiet)
    stack.callback(child.wait)
    stack.callback(child.kill)  # many processes that end in order at once take minutes
    return psutil.Process(child.pid)


def use(processes: list[psutil.Process]) -> Use:
    """Return the processor time and memory used so far."""
    times = [process.cpu_times() for process in processes]
    return Use([each.user + each.system for each in times], [process.memory_info().rss for process in processes])


def main(words: list[str]) -> int:
    """Measure and print; the exit code."""
    options = _parser().parse_args(words)
    if options.folder:  # a run of its own
        os.nice(LESS_URGENT)
        of = options.slaves[0], options.routers[0], options.seconds, options.sessions, options.step
        print(measure(ExitStack(), Path(options.folder), *of), flush=True)
        os._exit(0)  # closes nothing: sessions without their router take minutes to close
    load = psutil.getloadavg()[0]
    print(f"{os.cpu_count()} processors, load before: {load:.1f}\n\n{HEADER}\n{_rule(HEADER)}", flush=True)
    broken = []
    for routers in options.routers:
        for slaves in options.slaves:
            began = time.monotonic()
            row = _run(slaves, routers, options)
            took, load = time.monotonic() - began, psutil.getloadavg()[0]
            print(f"{slaves} slaves, {routers} routers: took {took:.0f} s, load {load:.1f}", file=sys.stderr)
            if row.count("|") == BROKEN.count("|"):
                broken.append(row)
            else:
                print(row, flush=True)
    if broken:
        print("\n".join(["", BROKEN, _rule(BROKEN), *broken]))
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__, prog="python -m tools.costs.scale")
    parser.add_argument("--slaves", type=int, nargs="+", default=[1, 2, 4, 8, 16, 32, 64])
    parser.add_argument("--routers", type=int, nargs="+", choices=(1, 2), default=[1, 2])
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument(
        "--sessions", choices=("one", "each"), default="one", help="of the observer: one, or one each vehicle"
    )
    parser.add_argument("--step", type=float, default=2.5, help="of the slaves, in ms [%(default)s]")
    parser.add_argument("--limit", type=float, default=600.0, help="of a run, in s: it is killed then [%(default)s]")
    parser.add_argument("--folder", help=argparse.SUPPRESS)
    return parser


def _run(slaves: int, routers: int, options: argparse.Namespace) -> str:
    """Return the row of one run, in a process of its own that is killed at the limit, with all that it started."""
    words = [f"--slaves={slaves}", f"--routers={routers}", f"--sessions={options.sessions}"]
    words += [f"--seconds={options.seconds}", f"--step={options.step}"]
    start = f"| {slaves} | {routers} | {options.step:g} ms |"
    try:
        with tempfile.TemporaryDirectory() as folder:
            command = module_command("tools.costs.scale", *words, f"--folder={folder}")
            run = finish_child(command, options.limit)
    except subprocess.TimeoutExpired:
        return f"{start} no result within {options.limit:g} s |"
    if run.returncode:
        last = (run.stderr.decode().strip() or f"exit code {run.returncode}").splitlines()[-1]
        return f"{start} ended: {last} |"
    return run.stdout.decode().strip()


def _rule(header: str) -> str:
    """Return the line of a table below its header."""
    return f"|{'---|' * (header.count('|') - 1)}"


if __name__ == "__main__":
    die_with_parent()
    sys.exit(main(sys.argv[1:]))
