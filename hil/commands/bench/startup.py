"""`uuv-hil bench startup`: measure a slave's start, cold and warm, phase by phase, beside bare interpreters."""

from collections.abc import Callable
from typing import Any

from hil.bench.harness import Bench
from hil.bench.record import Figure
from hil.bench.startup_run import AT_MASTER, PHASES, coldness, files_of_a_start, floors, start, time_floor
from hil.bench.statistics import median, spread
from hil.commands.bench.options import (
    add_repeat,
    add_results,
    add_under,
    benchmark,
    save_record,
    show,
)
from hil.commands.bench.partial_failures import PartialFailures
from hil.common.columns import aligned, paragraph
from hil.common.options import Number, add_scenario, changes_of, new_parser

EXAMPLES = """\
The slave and the interpreters start in turn. Warm: all files are in memory, from a start before. Cold: they have been
dropped from the page cache before each start; by default only the files that a start reads, as root with
--drop-caches all that the kernel caches.

examples:
  uuv-hil bench startup
  uuv-hil bench startup --repeat 20 --most 0.35          exit code 1 when a warm start takes longer (s, median)
  sudo uuv-hil bench startup --drop-caches
  uuv-hil bench startup --under "taskset -c 0" --output small.json
"""
LIMIT_BROKEN = 1
MAX = Number(0.0, 3600.0, "s")

Row = dict[str, float]  # phase of one start -> its duration, ms
Series = dict[str, list[float]]


@benchmark
def main(arguments: list[str]) -> int:
    """Measure and print; return 0, or 1 when a limit is broken. Raises HilError."""
    parser = new_parser("bench startup", __doc__, EXAMPLES)
    add_scenario(parser)
    add_repeat(parser, 10, "starts of each kind")
    parser.add_argument("--warm-only", action="store_true", help="leave the cold starts out")
    parser.add_argument("--drop-caches", action="store_true", help="cold: drop all caches of the machine, as root")
    parser.add_argument("--most", type=MAX, metavar="S", help="limit of a warm start, until the first sample")
    add_under(parser)
    add_results(parser)
    options = parser.parse_args(arguments)
    failures = PartialFailures()
    by_kind, notes, labels = _measure(options, failures)
    if not by_kind:
        failures.raise_first()
    print(_text(by_kind))
    print(f"medians of {failures.most(options.repeat)} starts each, (range of the middle half); ms")
    for line in notes:
        print(paragraph(line))
    figures = {f"{row} [{kind}]": Figure(v, "ms") for kind, rows in by_kind.items() for row, v in rows.items()}
    save_record("startup", options, figures, (*labels, *failures.labels), {"cold": notes})
    took = median(by_kind["warm"]["all"]) / 1e3
    broken = options.most is not None and not took <= options.most
    if broken:
        print(f"LIMIT BROKEN: a warm start takes {took:.3f} s, above {options.most:g} s")
    failures.raise_first()
    return LIMIT_BROKEN if broken else 0


def _measure(options: Any, failures: PartialFailures) -> tuple[dict[str, Series], list[str], tuple[str, ...]]:
    """Measure each kind of start; return the figures, how the cold start was made, and labels."""
    rows: dict[str, list[Row]] = {}
    labels: tuple[str, ...] = ()
    text = ""
    with failures.caught(), Bench(options.scenario, changes_of(options), options.under) as bench:
        labels = bench.labels
        show("the first start")
        start(bench)  # the next start prints each module, which would hide why a start fails
        files = files_of_a_start(bench)
        kinds = {"warm": _leave}
        if not options.warm_only:
            kinds["cold"], text = coldness(files, options.drop_caches)
        for kind, before in kinds.items():
            for number in range(options.repeat):
                failures.begin(f"{kind}: {number + 1} of {options.repeat}")
                row = _start(bench, before)
                rows.setdefault(kind, []).append(row)
    by_kind = {kind: {name: [row[name] for row in of_kind] for name in of_kind[0]} for kind, of_kind in rows.items()}
    return by_kind, [f"cold: {text}"] if "cold" in by_kind else [], labels


def _start(bench: Bench, before: Callable[[], None]) -> Row:
    """Start the slave and each bare interpreter once, and return the times. Raises NetworkError."""
    before()
    slave = start(bench)
    bare: Row = {}
    for name, code in floors().items():
        before()
        bare[name] = time_floor(bench, code)
    phases = slave.phases()
    return {**{name: phases[name] for name in (*PHASES.values(), AT_MASTER)}, "all": slave.total, **bare}


def _leave() -> None:
    """Leave the page cache warm."""


def _text(by_kind: dict[str, Series]) -> str:
    names = list(next(iter(by_kind.values())))
    rows = [["phase", *by_kind]]
    rows += [[name, *(_cell(series[name]) for series in by_kind.values())] for name in names]
    return "\n".join(aligned(rows, rule=True))


def _cell(values: list[float]) -> str:
    return f"{median(values):.1f} ({spread(values):.1f})" if len(values) > 1 else f"{median(values):.1f}"
