"""`uuv-hil bench soak`: hours of running: whether memory grows, time drifts, and a master always gets back."""

import os
from math import isnan
from typing import Any

from hil.bench.harness import Bench
from hil.bench.plotting import pyplot
from hil.bench.record import Figure, new_record
from hil.bench.soak_run import Look, Soak, soak, trend
from hil.bench.statistics import median
from hil.commands.bench_options import add_json, add_limits, add_scenario, changes_of, keep, limits_of, show
from hil.commands.parser import new_parser
from hil.errors import ConfigError
from hil.stop import StopSignals

EXAMPLES = """\
A slave that is commanded 20 times a second; the master leaves and comes back now and then. Growth is a straight line
through the memory, without the first tenth, with its interval of 95 %: it is told to be one when the interval is above
0 and the line steeper than --leak. Ctrl-C ends early and judges what there is.

examples:
  uuv-hil bench soak --hours 8 --json soak.json --png soak.png
  uuv-hil bench soak --hours 0.05 --every 2 --leave-every 30
"""
FOUND = 1
LATE_S = 1.0  # a return that takes longer is told


def main(arguments: list[str]) -> int:
    """Run and judge; 0, or 1 when something grows, drifts or does not come back. Raises HilError."""
    parser = new_parser("bench soak", __doc__, EXAMPLES)
    add_scenario(parser)
    add = parser.add_argument
    add("--hours", type=float, default=1.0, metavar="H", help="[%(default)s]")
    add("--every", type=float, default=10.0, metavar="S", help="between looks [%(default)s]")
    add("--leave-every", type=float, default=300.0, metavar="S", help="the master comes back anew [%(default)s]")
    add("--leak", type=float, default=0.5, metavar="MIB", help="growth an hour that is one [%(default)s]")
    add_limits(parser)
    add_json(parser)
    add("--png", metavar="FILE", help="memory, delay and time over the run")
    options = parser.parse_args(arguments)
    if not (0.001 <= options.hours <= 10_000.0 and 0.2 <= options.every <= options.leave_every):
        raise ConfigError("command line: --hours from 0.001, --every from 0.2 and not above --leave-every")
    with StopSignals() as stop_fd, Bench(options.scenario, changes_of(options), limits_of(options)) as bench:
        found = soak(bench, options.hours * 3600.0, options.every, options.leave_every, _show, stop_fd)
        labels = bench.labels
    show("")
    if not found.looks:
        print("ended before the first look")
        return 130
    findings = _judge(found, options.leak)
    keep(_record(found, options, labels), options)
    if options.png:
        _draw(found, options.png)
    return FOUND if findings else 0


def _show(look: Look) -> None:
    show(
        f"{look.at_s / 3600.0:.2f} h: {look.memory:.2f} MiB, {look.threads} threads, {look.descriptors} descriptors, "
        f"{look.steps_skipped:.0f} steps skipped, delay p50 {look.delay_p50_ms:.2f} ms"
    )


def _judge(found: Soak, leak: float) -> list[str]:
    """Print what came out; the findings that are bad."""
    looks = found.looks[len(found.looks) // 10 :]
    first, last = looks[0], looks[-1]
    slope, interval = trend([look.at_s for look in looks], [look.memory for look in looks])
    bad = []
    print(f"{last.at_s / 3600.0:.2f} h, {len(found.looks)} looks")
    if isnan(slope):
        print("memory: too few looks for a line")
    else:
        print(f"memory: {first.memory:.2f} -> {last.memory:.2f} MiB; {slope:+.3f} MiB an hour "
              f"({interval.low:+.3f} to {interval.high:+.3f})")  # fmt: skip
        if slope > leak and interval.low > 0.0:
            bad.append(f"memory grows by {slope:.2f} MiB an hour")
    print(f"threads {first.threads} -> {last.threads}, descriptors {first.descriptors} -> {last.descriptors}")
    if last.descriptors > first.descriptors + 5:
        bad.append(f"descriptors grow from {first.descriptors} to {last.descriptors}")
    print(f"real-time factor {last.real_time_factor:.5f}, {last.steps_skipped:.0f} steps skipped")
    if abs(last.real_time_factor - 1.0) > 1e-3:
        bad.append(f"time drifts: the real-time factor is {last.real_time_factor:.4f}")
    delays = [look.delay_p50_ms for look in found.looks if not isnan(look.delay_p50_ms)]
    print(f"command delay p50: median {median(delays):.3f} ms, at most {max(delays, default=float('nan')):.3f} ms")
    bad += _judge_returns(found.returns)
    for text in bad:
        print(f"FOUND: {text}")
    return bad


def _judge_returns(returns: list[float | None]) -> list[str]:
    there = [seconds for seconds in returns if seconds is not None]
    slowest = max(there, default=0.0)
    print(f"the master came {len(there)} of {len(returns)} times; first sample after {slowest:.3f} s at most")
    bad = [f"{len(returns) - len(there)} times the vehicle did not answer"] if len(there) < len(returns) else []
    return bad + ([f"a return took {max(there):.1f} s"] if there and max(there) > LATE_S else [])


def _record(found: Soak, options: Any, labels: tuple[str, ...]) -> Any:
    looks = found.looks
    figures = {
        "memory": Figure([look.memory for look in looks], "MiB"),
        "descriptors": Figure([float(look.descriptors) for look in looks], "", ""),
        "delay p50": Figure([look.delay_p50_ms for look in looks], "ms"),
        "return": Figure([seconds for seconds in found.returns if seconds is not None], "s"),
        "at": Figure([look.at_s for look in looks], "s", ""),
    }
    settings = {key: getattr(options, key) for key in ("scenario", "set", "hours", "every", "leave_every")}
    return new_record("soak", settings, figures, labels)


def _draw(found: Soak, path: str) -> None:
    plt = pyplot()
    figure, panels = plt.subplots(3, 1, figsize=(10, 8), layout="constrained", sharex=True)
    hours = [look.at_s / 3600.0 for look in found.looks]
    for panel, name, label in zip(
        panels,
        ("memory", "delay_p50_ms", "descriptors"),
        ("memory (MiB)", "delay p50 (ms)", "descriptors"),
        strict=True,
    ):
        panel.plot(hours, [getattr(look, name) for look in found.looks])
        panel.set(ylabel=label)
    panels[-1].set(xlabel="time (h)")
    try:
        figure.savefig(path, dpi=110)
    except (OSError, ValueError) as error:
        raise ConfigError(f"{os.path.abspath(path)}: cannot be written: {error}") from None
    finally:
        plt.close(figure)
