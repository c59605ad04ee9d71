"""`uuv-hil bench startup`: measure a slave's start, cold and warm, phase by phase, beside bare interpreters."""

from collections.abc import Callable
from typing import Any

from hil.bench.harness import Bench
from hil.bench.record import Figure
from hil.bench.report import Column, Row, text
from hil.bench.startup_run import AT_MASTER, PHASES, coldness, files_of_a_start, floors, start, time_floor
from hil.commands.bench.options import add_repeat, bench_parser, benchmark, parse, save_columns, show
from hil.commands.bench.partial_failures import PartialFailures
from hil.common.columns import paragraph
from hil.common.options import Number, changes_of

EXAMPLES = """\
The slave and the interpreters start in turn. Warm: all files are in memory, from a start before. Cold: they have been
dropped from the page cache before each start; by default only those of Python and of this project, as root with
--drop-caches all that the kernel caches.

examples:
  uuv-hil bench startup
  uuv-hil bench startup --repeat 20 --most 0.35          exit code 1 when a warm start takes longer (s, median)
  sudo uuv-hil bench startup --drop-caches
  uuv-hil bench startup --under "taskset -c 0" --output small.json
"""
LIMIT_BROKEN = 1
MAX = Number(0.0, 3600.0, "s")

Phases = dict[str, float]  # phase of one start -> its duration, ms


@benchmark
def main(arguments: list[str]) -> int:
    """Measure and print; return 0, or 1 when a limit is broken. Raises HilError."""
    parser = bench_parser("startup", __doc__, EXAMPLES)
    add_repeat(parser, 10, "starts of each kind")
    parser.add_argument("--warm-only", action="store_true", help="leave the cold starts out")
    parser.add_argument("--drop-caches", action="store_true", help="cold: drop all caches of the machine, as root")
    parser.add_argument("--most", type=MAX, metavar="S", help="limit of a warm start, until the first sample")
    options = parse(parser, arguments)
    failures = PartialFailures()
    columns, notes, labels = _measure(options, failures)
    if not columns:
        failures.raise_first()
    rows = [Row(name, name, "ms", "{:.1f}") for name in columns[0].figures]
    print(text(columns, rows))
    print(f"medians of {failures.most(options.repeat)} starts each, (range of the middle half); ms")
    for line in notes:
        print(paragraph(line))
    save_columns("startup", options, columns, rows, (*labels, *failures.labels), {"cold": notes})
    took = columns[0].figures["all"].median / 1e3
    broken = options.most is not None and not took <= options.most
    if broken:
        print(f"LIMIT BROKEN: a warm start takes {took:.3f} s, above {options.most:g} s")
    failures.raise_first()
    return LIMIT_BROKEN if broken else 0


def _measure(options: Any, failures: PartialFailures) -> tuple[list[Column], list[str], tuple[str, ...]]:
    """Measure each kind of start, warm first; return the figures, how the cold start was made, and labels."""
    starts: dict[str, list[Phases]] = {}
    labels: tuple[str, ...] = ()
    how = ""
    with failures.caught(), Bench(options.scenario, changes_of(options), options.under) as bench:
        labels = bench.labels
        show("the first start")
        start(bench)  # which brings the files into memory
        files = files_of_a_start()
        kinds = {"warm": _leave}
        if not options.warm_only:
            kinds["cold"], how = coldness(files, options.drop_caches)
        for kind, before in kinds.items():
            for number in range(options.repeat):
                failures.begin(f"{kind}: {number + 1} of {options.repeat}")
                phases = _start(bench, before)
                starts.setdefault(kind, []).append(phases)
    columns = [
        Column(kind, {name: Figure([each[name] for each in of_kind], "ms") for name in of_kind[0]})
        for kind, of_kind in starts.items()
    ]
    return columns, [f"cold: {how}"] if "cold" in starts else [], labels


def _start(bench: Bench, before: Callable[[], None]) -> Phases:
    """Start the slave and each bare interpreter once, and return the times. Raises NetworkError."""
    before()
    slave = start(bench)
    bare: Phases = {}
    for name, code in floors().items():
        before()
        bare[name] = time_floor(bench, code)
    phases = slave.phases()
    return {**{name: phases[name] for name in (*PHASES.values(), AT_MASTER)}, "all": slave.total, **bare}


def _leave() -> None:
    """Leave the page cache warm."""
