"""`uuv-hil bench startup`: measure a slave's start, cold and warm, phase by phase, beside bare interpreters."""

from typing import Any

from hil.bench.harness import Bench
from hil.bench.record import Figure
from hil.bench.report import Column, Row, text
from hil.bench.startup_run import drop, files_of_a_start, floors, start, time_floor
from hil.commands.bench.options import PartialFailures, add_repeat, bench_parser, benchmark, parse, save_columns, show
from hil.common.columns import paragraph
from hil.common.options import changes_of

EXAMPLES = """\
The slave and the interpreters start in turn. Warm: all files are in memory, from a start before. Cold: those of Python
and of this project have been dropped from the page cache before each start.

examples:
  uuv-hil bench startup
  uuv-hil bench startup --repeat 20
  uuv-hil bench startup --under "taskset -c 0" --output small.json
"""
Phases = dict[str, float]  # phase of one start -> its duration, ms


@benchmark
def main(arguments: list[str]) -> int:
    """Measure and print; return the exit code. Raises HilError."""
    parser = bench_parser("startup", __doc__, EXAMPLES)
    add_repeat(parser, 10, "starts of each kind")
    parser.add_argument("--warm-only", action="store_true", help="leave the cold starts out")
    options = parse(parser, arguments)
    failures = PartialFailures()
    columns, labels = _measure(options, failures)
    if not columns:
        failures.raise_first()
    rows = [Row(name, name, "ms", "{:.1f}") for name in columns[0].figures]
    print(text(columns, rows))
    print(f"medians of {failures.most(options.repeat)} starts each, (range of the middle half); ms")
    if len(columns) > 1:
        print(paragraph("cold: pages that a running process has mapped stay in memory, such as Python's"))
    save_columns("startup", options, columns, rows, (*labels, *failures.labels))
    failures.raise_first()
    return 0


def _measure(options: Any, failures: PartialFailures) -> tuple[list[Column], tuple[str, ...]]:
    """Measure each kind of start, warm first; return the figures, and labels."""
    starts: dict[str, list[Phases]] = {}
    labels: tuple[str, ...] = ()
    with failures.caught(), Bench(options.scenario, changes_of(options), options.under) as bench:
        labels = bench.labels
        show("the first start")
        start(bench)  # which brings the files into memory
        dropped: dict[str, list[str]] = {"warm": []} | ({} if options.warm_only else {"cold": files_of_a_start()})
        for kind, files in dropped.items():
            for number in range(options.repeat):
                failures.begin(f"{kind}: {number + 1} of {options.repeat}")
                phases = _start(bench, files)
                starts.setdefault(kind, []).append(phases)
    columns = [
        Column(kind, {name: Figure([each[name] for each in of_kind], "ms") for name in of_kind[0]})
        for kind, of_kind in starts.items()
    ]
    return columns, labels


def _start(bench: Bench, files: list[str]) -> Phases:
    """Start the slave and each bare interpreter once, each after `files` are dropped from memory; return the times.

    Raises NetworkError.
    """
    drop(files)
    took = start(bench)
    for name, code in floors().items():
        drop(files)
        took[name] = time_floor(bench, code)
    return took
