"""`uuv-hil bench jitter`: measure how late the slave's loop wakes up, compared with the kernel and an empty loop."""

import os
from contextlib import ExitStack
from typing import Any, NamedTuple

from hil.bench.harness import Bench
from hil.bench.jitter_run import NOTE, Cycles, Lateness, bare_loop, changes_for, cyclictest, slave_loop
from hil.bench.limits import Limits
from hil.bench.presence import simulation_of
from hil.bench.record import Figure
from hil.bench.statistics import median
from hil.commands.bench.options import (
    add_limits,
    add_repeat,
    add_results,
    add_seconds,
    benchmark,
    limits_of,
    save_record,
    show,
)
from hil.commands.bench.partial_failures import PartialFailures
from hil.common.columns import aligned, paragraph
from hil.common.options import List, Number, add_scenario, changes_of, new_parser

EXAMPLES = f"""\
For each rate, one after the other on the same processor: cyclictest (rt-tests, where it is installed), the slave's loop
with nothing to do, and the slave with a master that commands it 20 times a second. A wake-up that is three periods
late counts as three late cycles. The figures include the start of the loop.

{NOTE}

examples:
  uuv-hil bench jitter                                     250 Hz, 400 Hz and 1 kHz, pinned to the last processor
  uuv-hil bench jitter --rates 400 --seconds 60 --output jitter.json
  uuv-hil bench jitter --repeat 5 --output today.json        enough for `uuv-hil bench compare`
  uuv-hil bench jitter --cpus 0 --check                    exit code 1 when less than 99 % of cycles are within 2 ms
"""
WITHIN = 0.99
MISSED = 1
RATES = List(Number(50.0, 5000.0, "Hz"))


class RateResult(NamedTuple):
    """One rate in one run."""

    kernel: Lateness | None
    bare: Lateness
    slave: Cycles


@benchmark
def main(arguments: list[str]) -> int:
    """Measure and print; return 0, or 1 with --check when cycles are missed. Raises HilError."""
    options = _parser().parse_args(arguments)
    rates = options.rates
    limits = limits_of(options)
    limits = limits if limits.cpus else limits._replace(cpus=(_last_cpu(),))
    by_rate: dict[float, list[RateResult]] = {}
    labels: tuple[str, ...] = ()
    failures = PartialFailures()
    with failures.caught(), ExitStack() as stack:
        benches = [_bench(rate, options, limits, stack) for rate in rates]
        labels = benches[0].labels
        for number in range(options.repeat):
            for rate, bench in zip(rates, benches, strict=True):
                progress = f"run {number + 1} of {options.repeat}: {rate:g} Hz"
                failures.begin(progress)
                run = _measure(bench, options.seconds, progress)
                by_rate.setdefault(rate, []).append(run)
    if not by_rate:
        failures.raise_first()
    print("\n".join(_table(by_rate)))
    if options.repeat > 1:
        print(f"medians of {failures.most(options.repeat)} runs")
    pinned = f"pinned to processor {','.join(map(str, limits.cpus))}"
    print(paragraph(f"{pinned}; behind: cycles that are missing at the end"))
    print(paragraph(NOTE))
    figures = {
        name: figure for rate, runs in by_rate.items() for name, figure in _figures(f"{rate:g} Hz", runs).items()
    }
    options.cpus = limits.cpus
    save_record("jitter", options, figures, (*labels, *failures.labels))
    is_met = all(run.slave.within >= WITHIN for runs in by_rate.values() for run in runs)
    if options.check and not is_met:
        print(f"MISSED: less than {WITHIN:.0%} of the cycles were within 2 ms")
    failures.raise_first()
    return MISSED if options.check and not is_met else 0


def _parser() -> Any:
    parser = new_parser("bench jitter", __doc__, EXAMPLES)
    add_scenario(parser)
    add = parser.add_argument
    add("--rates", default="250,400,1000", metavar="LIST", type=RATES, help="loop rates in Hz [%(default)s]")
    add_seconds(parser, 20.0, "run")
    add_repeat(parser, 1, "whole runs, each with new slaves")
    add("--check", action="store_true", help="check that 99 %% of the cycles are within 2 ms")
    add_limits(parser)
    add_results(parser)
    return parser


def _bench(rate: float, options: Any, limits: Limits, stack: ExitStack) -> Bench:
    """Return the bench of that rate's slaves. Its scenario is checked before any measurement. Raises ConfigError."""
    bench = stack.enter_context(Bench(options.scenario, changes_of(options) | changes_for(rate), limits))
    simulation_of(bench.scenario)
    return bench


def _measure(bench: Bench, seconds: float, progress: str) -> RateResult:
    def watch(share: float) -> None:
        show(f"{progress}: slave {share:4.0%}")

    show(f"{progress}: cyclictest")
    kernel = cyclictest(bench, seconds / 2)
    show(f"{progress}: bare loop")
    bare = bare_loop(bench, seconds / 2)
    return RateResult(kernel, bare, slave_loop(bench, seconds, watch))


def _table(by_rate: dict[float, list[RateResult]]) -> list[str]:
    """Return medians over the runs."""
    rows = [["", "late p50 us", "p99", "p99.9", "max", "within 2 ms", "skipped", "behind"]]
    for rate, runs in by_rate.items():
        name = f"{rate:g} Hz"
        kernels = [run.kernel for run in runs if run.kernel]
        if kernels:
            mean = f"{median([kernel.mean for kernel in kernels]):.0f} (mean)"
            rows.append([f"{name}, cyclictest", *_cells(kernels), mean, "", ""])
        else:
            rows.append([f"{name}, cyclictest not installed or not permitted", *[""] * 7])
        rows.append([f"{name}, bare loop", *_cells([run.bare for run in runs]), "", "", ""])
        slaves = [run.slave for run in runs]
        within, skipped, drift = (
            median([float(getattr(each, name)) for each in slaves]) for name in ("within", "skipped", "drift")
        )
        late = _cells([each.late for each in slaves])
        rows.append([f"{name}, slave", *late, f"{within:.3%}", f"{skipped:g}", f"{drift:.1f}"])
    return aligned(rows, rule=True)


def _cells(late: list[Lateness]) -> list[str]:
    return [f"{median(values):.0f}" for values in zip(*[each[:4] for each in late], strict=True)]


def _figures(name: str, runs: list[RateResult]) -> dict[str, Figure]:
    """Return a value for each run, which is a start of the slave."""
    slaves, kernels = [run.slave for run in runs], [run.kernel for run in runs if run.kernel]
    figures = {
        "slave p50": Figure([each.late.p50 for each in slaves], "us"),
        "slave p99": Figure([each.late.p99 for each in slaves], "us"),
        "slave p99.9": Figure([each.late.p999 for each in slaves], "us"),
        "slave max": Figure([each.late.maximum for each in slaves], "us"),
        "within 2 ms": Figure([100.0 * each.within for each in slaves], "%", "higher"),
        "skipped": Figure([float(each.skipped) for each in slaves], "cycles"),
        "bare p50": Figure([run.bare.p50 for run in runs], "us", ""),
        "bare p99": Figure([run.bare.p99 for run in runs], "us", ""),
    }
    if kernels:
        figures["cyclictest mean"] = Figure([each.mean for each in kernels], "us", "")
        ratios = [run.slave.late.p50 / run.kernel.mean for run in runs if run.kernel and run.kernel.mean]
        figures["slave p50 over cyclictest mean"] = Figure(ratios, "ratio")
    return {f"{name} {row}": each._replace(runs=(1,) * len(each.values)) for row, each in figures.items()}


def _last_cpu() -> int:
    return max(os.sched_getaffinity(0))
