"""How late the loop wakes up, beside what the kernel and a loop with nothing to do achieve on the same CPU."""

import json
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any, NamedTuple

from hil.autonomy.control import VelocityCommand
from hil.bench.harness import Bench, await_vehicle
from hil.bench.presence import check_end, check_there
from hil.clock import LOOP_PRIORITY, seconds_ns

COMMAND_HZ = 20.0
# The bare loop: the slave's clock, its scheduling and what it asks of the processors, and nothing to do.
BARE = """
import json, select, sys
from hil.clock import LOOP_PRIORITY, RateKeeper, now_ns, schedule_fifo, seconds_ns, stay_awake
period, seconds, realtime, awake = int(sys.argv[1]), float(sys.argv[2]), sys.argv[3] == "1", sys.argv[4] == "1"
if realtime:
    schedule_fifo(LOOP_PRIORITY)
if realtime and awake:
    stay_awake()
keeper = RateKeeper(period, now_ns())
end = now_ns() + seconds_ns(seconds)
while keeper.deadline_ns < end:
    select.select((), (), (), keeper.timeout())
    keeper.due(keeper.woken())
late = keeper.lateness
print(json.dumps({"p50": late.quantile(0.5), "p99": late.quantile(0.99), "p999": late.quantile(0.999),
                  "max": late.maximum}))
"""
NOTE = """\
cyclictest is what the kernel does for a program that sleeps until it is time. The slave, and the bare loop, wake a
little before, as early as they have learnt to need, and spin for the rest: so they can be below it."""


class Lateness(NamedTuple):
    """How late wake-ups were, us; `mean` of cyclictest, which tells no median; nan for what is not known."""

    p50: float
    p99: float
    p999: float
    maximum: float
    mean: float = float("nan")


class Cycles(NamedTuple):
    """What one slave's loop did at `rate` Hz: lateness, share of cycles within 2 ms, steps skipped, drift.

    `drift` is how much simulated and real time differ at the end, in steps: what the schedule has not caught up.
    """

    rate: float
    late: Lateness
    within: float
    skipped: int
    drift: float


def changes_for(rate: float) -> dict[str, Any]:
    """What makes a scenario's loop run at `rate` Hz."""
    return {"slave.step": 1.0 / rate, "slave.control_period": max(0.02, 2.0 / rate)}


def slave_loop(bench: Bench, seconds: float, watch: Callable[[float], None] = lambda _: None) -> Cycles:
    """Of the slave of `bench`, which runs so long with a master that commands it; `watch` gets the share that is done.

    Raises NetworkError when it ends or hangs.
    """
    slave = bench.start_slave()
    with bench.client() as client:
        await_vehicle(client, slave)
        count = round(seconds * COMMAND_HZ)
        for number in range(count):
            client.command(VelocityCommand())
            check_there(client, slave)
            watch(number / count)
            time.sleep(1.0 / COMMAND_HZ)
        check_end(client, slave)
        said = client.diagnostics()
    slave.stop()
    rate = 1.0 / bench.scenario.slave.step
    number_of = {name: float(said[name]) for name in said if name.startswith(("lateness_", "steps_"))}
    late = Lateness(*[number_of[f"lateness_{name}_us"] for name in ("p50", "p99", "p999", "max")])
    drift = float(said["behind_ms"]) * 1e-3 * rate
    return Cycles(rate, late, float(said["within_2ms"]), int(number_of["steps_skipped"]), drift)


def bare_loop(rate: float, seconds: float, cpu: int | None, realtime: bool = True, awake: bool = True) -> Lateness:
    """The slave's loop with nothing to do: the floor of the slave. `realtime`, `awake`: as of [slave]."""
    words = [str(seconds_ns(1.0 / rate)), str(seconds), str(int(realtime)), str(int(awake))]
    done = subprocess.run(
        _pinned([sys.executable, "-c", BARE, *words], cpu), capture_output=True, text=True, check=True
    )
    found = json.loads(done.stdout)
    return Lateness(*[found[name] / 1000.0 for name in ("p50", "p99", "p999", "max")])


def cyclictest(rate: float, seconds: float, cpu: int | None) -> Lateness | None:
    """What rt-tests' program finds for a thread that just sleeps; None where it is not installed or not permitted."""
    program = shutil.which("cyclictest")
    if not program:
        return None
    period_us = round(1e6 / rate)
    command = [
        program,
        "-q",
        "-m",
        "-t1",
        f"-p{LOOP_PRIORITY}",
        f"-i{period_us}",
        f"-l{round(seconds * rate)}",
        "-h2000",
    ]
    done = subprocess.run(_pinned(command, cpu), capture_output=True, text=True, check=False)
    if done.returncode:
        return None
    return read_cyclictest(done.stdout)


def read_cyclictest(text: str) -> Lateness | None:
    """Its histogram: lines "us count", then "# Avg Latencies: 00012" and the like; None if that is not there."""
    counts = [(int(us), int(count)) for us, count in re.findall(r"^(\d{6})\s+(\d+)$", text, re.M)]
    average = re.search(r"# Avg Latencies:\s*(\d+)", text)
    greatest = re.search(r"# Max Latencies:\s*(\d+)", text)
    total = sum(count for _, count in counts)
    if not total or not average or not greatest:
        return None
    p50, p99, p999 = (_quantile(counts, total, share) for share in (0.5, 0.99, 0.999))
    return Lateness(p50, p99, p999, int(greatest[1]), int(average[1]))


def _quantile(counts: list[tuple[int, int]], total: int, share: float) -> float:
    seen = 0
    for us, count in counts:
        seen += count
        if seen >= share * total:
            return float(us)
    return float("nan")


def _pinned(command: list[str], cpu: int | None) -> list[str]:
    return command if cpu is None else ["taskset", "-c", str(cpu), *command]
