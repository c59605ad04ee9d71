"""How late the loop wakes up, beside what the kernel and the bare interpreter do at the same rate on the same CPU."""

import json
import re
import shutil
import subprocess
import sys
import time
from typing import Any, NamedTuple

from hil.autonomy.control import VelocityCommand
from hil.bench.harness import Bench, await_vehicle
from hil.bench.limits import Limits
from hil.clock import seconds_ns
from hil.errors import NetworkError

PRIORITY = 40  # of the floors, that of the slave
# The bare loop: the slave's clock and scheduling, and nothing to do.
BARE = """
import json, select, sys
from hil.clock import RateKeeper, now_ns, schedule_fifo
period, seconds, priority = int(sys.argv[1]), float(sys.argv[2]), int(sys.argv[3])
note = schedule_fifo(priority)
keeper = RateKeeper(period, now_ns())
end = now_ns() + seconds * 1e9
while now_ns() < end:
    wait = keeper.deadline_ns - now_ns()
    select.select((), (), (), wait / 1e9 if wait > 0 else 0.0)
    keeper.due(now_ns())
late = keeper.lateness
print(json.dumps({"p50": late.quantile(0.5), "p99": late.quantile(0.99), "p999": late.quantile(0.999),
                  "max": late.maximum, "note": note}))
"""


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


def slave_loop(
    rate: float, seconds: float, scenario: str, limits: Limits, more: dict[str, Any] | None = None
) -> Cycles:
    """Of a slave that runs so long at `rate` Hz with a master that commands it. Raises NetworkError."""
    changes = (more or {}) | {"slave.step": 1.0 / rate, "slave.control_period": max(0.02, 2.0 / rate)}
    with Bench(scenario, changes, limits) as bench:
        slave = bench.start_slave()
        with bench.client() as client:
            await_vehicle(client, slave)
            for _ in range(round(seconds * 20)):
                client.command(VelocityCommand())
                if not slave.running:
                    raise NetworkError(f"the slave ended: {slave.last_words}")
                time.sleep(0.05)
            said = client.diagnostics()
    number = {name: float(said[name]) for name in said if name.startswith(("lateness_", "steps_", "real_time"))}
    late = Lateness(*[number[f"lateness_{name}_us"] for name in ("p50", "p99", "p999", "max")])
    drift = float(said["behind_ms"]) * 1e-3 * rate
    return Cycles(rate, late, float(said["within_2ms"]), int(number["steps_skipped"]), drift)


def bare_loop(rate: float, seconds: float, cpu: int | None) -> Lateness:
    """A loop in Python that does nothing, scheduled like the slave."""
    code = [sys.executable, "-c", BARE, str(seconds_ns(1.0 / rate)), str(seconds), str(PRIORITY)]
    done = subprocess.run(_pinned(code, cpu), capture_output=True, text=True, check=True)
    found = json.loads(done.stdout)
    return Lateness(*[found[name] / 1000.0 for name in ("p50", "p99", "p999", "max")])


def cyclictest(rate: float, seconds: float, cpu: int | None) -> Lateness | None:
    """What rt-tests' program finds; None where it is not installed or not permitted."""
    program = shutil.which("cyclictest")
    if not program:
        return None
    period_us = round(1e6 / rate)
    command = [program, "-q", "-m", "-t1", f"-p{PRIORITY}", f"-i{period_us}", f"-l{round(seconds * rate)}", "-h2000"]
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
