"""Measure wake-up lateness of the loop, of the kernel (cyclictest), and of an empty loop on the same CPU."""

import json
import re
import shutil
import time
from bisect import bisect_left
from collections.abc import Callable
from itertools import accumulate
from typing import Any, NamedTuple

from hil.autonomy.control.controller import VelocityCommand
from hil.bench.harness import Bench, await_vehicle
from hil.bench.presence import check_end, check_present
from hil.common.children import foreign_command, python_command
from hil.common.clock import LOOP_PRIORITY, seconds_ns
from hil.common.errors import NetworkError
from hil.common.quantiles import rank
from hil.ros.diagnostics import or_nan

COMMAND_HZ = 20.0
# The bare loop has the slave's clock and scheduling, and the same requests to the processors, but does no work.
BARE = """
import json, select, sys
from hil.common.lifeline import die_with_parent
die_with_parent()
from hil.common.clock import LOOP_PRIORITY, RateKeeper, now_ns, schedule_fifo, seconds_ns, stay_awake
period, seconds, realtime, awake = int(sys.argv[1]), float(sys.argv[2]), sys.argv[3] == "1", sys.argv[4] == "1"
if realtime:
    schedule_fifo(LOOP_PRIORITY)
if realtime and awake:
    stay_awake()
keeper = RateKeeper(period, now_ns())
end = now_ns() + seconds_ns(seconds)
while keeper.deadline_ns < end:
    select.select((), (), (), keeper.timeout())
    keeper.due(keeper.on_wakeup())
late = keeper.lateness
print(json.dumps({"p50": late.quantile(0.5), "p99": late.quantile(0.99), "p999": late.quantile(0.999),
                  "max": late.maximum}))
"""
NOTE = """\
cyclictest is what the kernel does for a program that sleeps until it is time. The slave, and the bare loop, wake a
little before, as early as they have learnt to need, and spin for the rest: so they can be below it."""


class Lateness(NamedTuple):
    """Lateness of wake-ups in us; `mean` is that of cyclictest, which gives no median; nan if not known."""

    p50: float
    p99: float
    p999: float
    maximum: float
    mean: float = float("nan")


class Cycles(NamedTuple):
    """One slave's loop at `rate` Hz: lateness, share of cycles within 2 ms, steps skipped, drift.

    `drift` is the difference of simulated and real time at the end, in steps.
    """

    rate: float
    late: Lateness
    within: float
    skipped: int
    drift: float


def changes_for(rate: float) -> dict[str, Any]:
    """Return the changes with which a scenario's loop runs at `rate` Hz."""
    return {"slave.step": 1.0 / rate, "slave.control_period": max(0.02, 2.0 / rate)}


def slave_loop(bench: Bench, seconds: float, watch: Callable[[float], None] = lambda _: None) -> Cycles:
    """Measure the loop of the slave of `bench` under commands; `watch` gets the progress (0 to 1).

    Raises NetworkError when it ends or hangs.
    """
    slave = bench.start_slave()
    with bench.client() as client:
        await_vehicle(client, slave)
        count = round(seconds * COMMAND_HZ)
        for number in range(count):
            client.command(VelocityCommand())
            check_present(client, slave)
            watch(number / count)
            time.sleep(1.0 / COMMAND_HZ)
        check_end(client, slave)
        output = client.diagnostics()
    slave.stop()
    rate = 1.0 / bench.scenario.slave.step
    late = Lateness(*[or_nan(output[f"lateness_{name}_us"]) for name in ("p50", "p99", "p999", "max")])
    drift = or_nan(output.behind_ms) * 1e-3 * rate
    return Cycles(rate, late, or_nan(output.within_2ms), output.steps_skipped or 0, drift)


def bare_loop(bench: Bench, seconds: float) -> Lateness:
    """Return the lateness of a loop without work, under the limits of `bench`: the floor. Raises NetworkError."""
    slave = bench.scenario.slave
    words = [str(seconds_ns(slave.step)), str(seconds), str(int(slave.realtime)), str(int(slave.stay_awake))]
    code, output = _run(bench, "bare-loop", python_command("-c", BARE, *words))
    if code:
        raise NetworkError(f"the bare loop failed: {output}")
    lateness = json.loads(output.splitlines()[-1])
    return Lateness(*[lateness[name] / 1000.0 for name in ("p50", "p99", "p999", "max")])


def cyclictest(bench: Bench, seconds: float) -> Lateness | None:
    """Return the lateness of a thread that only sleeps, by rt-tests' program, at the slave's rate and under its limits.

    None where it is not installed or not permitted.
    """
    program = shutil.which("cyclictest")
    if not program:
        return None
    slave = bench.scenario.slave
    often = [f"-i{round(slave.step * 1e6)}", f"-l{round(seconds / slave.step)}"]
    priority = [f"-p{LOOP_PRIORITY}"] if slave.realtime else []
    code, output = _run(bench, "cyclictest", foreign_command(program, "-q", "-m", "-t1", *priority, *often, "-h2000"))
    return None if code else read_cyclictest(output)


def _run(bench: Bench, name: str, command: list[str]) -> tuple[int, str]:
    """Return its exit code and its output."""
    process = bench.start(name, command, limited=True)
    return process.join(), process.output


def read_cyclictest(text: str) -> Lateness | None:
    """Parse its histogram: lines "us count", then "# Avg Latencies: 00012" and the like; None without one."""
    counts = [(int(us), int(count)) for us, count in re.findall(r"^(\d{6})\s+(\d+)$", text, re.M)]
    average = re.search(r"# Avg Latencies:\s*(\d+)", text)
    greatest = re.search(r"# Max Latencies:\s*(\d+)", text)
    total = sum(count for _, count in counts)
    if not total or not average or not greatest:
        return None
    seen = list(accumulate(count for _, count in counts))
    p50, p99, p999 = (counts[bisect_left(seen, rank(share, total))][0] for share in (0.5, 0.99, 0.999))
    return Lateness(p50, p99, p999, int(greatest[1]), int(average[1]))
