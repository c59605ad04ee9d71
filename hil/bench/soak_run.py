"""Hours of running, looked at every few seconds: does memory grow, does time drift, does a master always get back?"""

import select
import time
from collections.abc import Callable, Sequence
from math import nan
from random import Random
from typing import NamedTuple

from hil.autonomy.control import VelocityCommand
from hil.bench.harness import Bench, Process, await_vehicle
from hil.bench.processes import look
from hil.bench.statistics import Interval, quantile
from hil.clock import NS_PER_MS
from hil.errors import NetworkError
from hil.master.client import VehicleClient

COMMAND_HZ = 20.0
BLOCKS = 20  # of the record that are drawn anew for an interval
DRAWS = 1000


class Look(NamedTuple):
    """One look at the slave: `at_s` since the start, memory (MiB), threads, descriptors, what it says of itself."""

    at_s: float
    memory: float
    threads: int
    descriptors: int
    real_time_factor: float
    steps_skipped: float
    delay_p50_ms: float


class Soak(NamedTuple):
    """All looks, and how long (s) each return of the master took until data flowed; None where they never did."""

    looks: list[Look]
    returns: list[float | None]


def soak(
    bench: Bench, seconds: float, every: float, leave_every: float, watch: Callable[[Look], None], stop_fd: int = -1
) -> Soak:
    """Command a slave for so long; the master leaves and comes back every `leave_every` s. Raises NetworkError."""
    slave = bench.start_slave()
    began = time.monotonic()
    found = Soak([], [])
    while time.monotonic() - began < seconds:
        dialled = time.monotonic()
        with bench.client() as client:
            try:
                await_vehicle(client, slave, 10.0)
                found.returns.append((client.first_sample_wall_ns - client.dialled_wall_ns) * 1e-9)
            except NetworkError:
                if not slave.running:
                    raise
                found.returns.append(None)
                continue
            end = min(dialled + leave_every, began + seconds)
            if not _stay(client, slave, began, end, every, found.looks, watch, stop_fd):
                break
    return found


def _stay(
    client: VehicleClient,
    slave: Process,
    began: float,
    end: float,
    every: float,
    looks: list[Look],
    watch: Callable[[Look], None],
    stop_fd: int,
) -> bool:
    """Command until `end`; False if told to stop."""
    due = time.monotonic() + every
    while time.monotonic() < end:
        client.command(VelocityCommand(surge=0.2, yaw_rate=0.2))
        if select.select([stop_fd] if stop_fd >= 0 else [], (), (), 1.0 / COMMAND_HZ)[0]:
            return False
        if time.monotonic() >= due:
            due += every
            looks.append(_look(client, slave, time.monotonic() - began))
            watch(looks[-1])
    return True


def _look(client: VehicleClient, slave: Process, at_s: float) -> Look:
    if not slave.running:
        raise NetworkError(f"the slave ended: {slave.last_words}")
    seen, said = look(slave.family()), client.diagnostics()
    delays = sorted(client.delays.totals_ns(200))
    return Look(
        at_s,
        seen.pss_mib,
        len(seen.cpu_s),
        seen.descriptors,
        float(said["real_time_factor"]),
        float(said["steps_skipped"]),
        quantile(delays, 0.5) / NS_PER_MS if delays else nan,
    )


def trend(at_s: Sequence[float], values: Sequence[float], seed: int = 1) -> tuple[float, Interval]:
    """Slope in units an hour by least squares, and where it lies with 95 %: blocks of the record drawn anew.

    Blocks, because neighbours are alike (moving block bootstrap: Kuensch, Annals of Statistics 17, 1989).
    """
    if len(values) < 3:
        return nan, Interval(nan, nan)
    random = Random(seed)
    length = max(len(values) // BLOCKS, 1)
    line = _line(at_s, values)
    left = [value - (line[0] + line[1] * at) for at, value in zip(at_s, values, strict=True)]
    slopes = []
    for _ in range(DRAWS):
        drawn: list[float] = []
        while len(drawn) < len(values):
            first = random.randrange(len(left) - length + 1)
            drawn += left[first : first + length]
        slopes.append(_line(at_s, drawn[: len(values)])[1] + line[1])
    slopes.sort()
    per_hour = 3600.0
    return line[1] * per_hour, Interval(quantile(slopes, 0.025) * per_hour, quantile(slopes, 0.975) * per_hour)


def _line(x: Sequence[float], y: Sequence[float]) -> tuple[float, float]:
    """Intercept and slope by least squares."""
    mean_x, mean_y = sum(x) / len(x), sum(y) / len(y)
    spread = sum((a - mean_x) ** 2 for a in x)
    slope = sum((a - mean_x) * (b - mean_y) for a, b in zip(x, y, strict=True)) / spread if spread else 0.0
    return mean_y - slope * mean_x, slope
