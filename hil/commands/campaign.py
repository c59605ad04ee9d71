"""`uuv-hil campaign`: run a mission many times in simulated time, with other seeds and parameters, on all cores."""

import argparse
import math
import statistics
import sys
import threading
import time
from collections.abc import Sequence
from contextlib import closing

from hil.cases.campaign import METRICS, Changes, Row, RunProgress, combinations, run_all
from hil.cases.table import write_rows
from hil.common.columns import aligned
from hil.common.errors import ConfigError
from hil.common.options import JOBS, SEEDS, add_json, add_output, add_scenario, changes_of, new_parser
from hil.common.scratch import ScratchFolder
from hil.common.stop import ctrl_c_held_back
from hil.common.streams import ProgressLine
from hil.common.text import json_text
from hil.scenario.config import load_single
from sim.run_events import KINDS

EXAMPLES = """\
Every combination of the values given with --vary is run with every seed. A key is written as in the
scenario file, with dots for sections; a value as in TOML, or as plain text.

examples:
  uuv-hil campaign paper_field --seeds 20
  uuv-hil campaign paper_field --seeds 10 --vary master.speed=0.5,0.7,0.9 -o speeds.csv
  uuv-hil campaign paper_field --vary sensors.odometry.horizontal.bias=0.1,0.5,1.0 --seeds 5
"""
MAX_RUNS = 1_000_000
UPDATE_S = 0.5  # between two readings of the progress
LEAST_SHARE = 0.001  # of all runs, from which the time that is left can be estimated


def main(arguments: list[str]) -> int:
    """Run the campaign; return 0 when every run reached its goal and nothing went wrong in any, else 6."""
    parser = new_parser("campaign", __doc__, EXAMPLES)
    add_scenario(parser)
    parser.add_argument("--seeds", type=SEEDS, default=10, metavar="N", help="seeds 1 to N [%(default)s]")
    parser.add_argument(
        "--vary", action="append", default=[], metavar="KEY=A,B,...", help="values of a key to try; repeatable"
    )
    parser.add_argument("--jobs", type=JOBS, default=-1, metavar="N", help="processes at once [all cores]")
    add_output(parser, "FILE.csv", "a row a run")
    add_json(parser)
    options = parser.parse_args(arguments)
    fixed = changes_of(options)
    sets = combinations(options.vary)
    if len(sets) * options.seeds > MAX_RUNS:
        raise ConfigError(
            f"--vary and --seeds: {len(sets)} combinations with {options.seeds} seeds each are more than {MAX_RUNS} "
            "runs: give fewer, or several campaigns"
        )
    for changes in sets:  # find a wrong key before the first run
        load_single(options.scenario, fixed | changes, option="--set or --vary")
    rows = _run(options.scenario, [fixed | changes for changes in sets], options)
    print(json_text(rows) if options.json else summary(rows, sets), flush=True)
    if options.output:
        write_rows(options.output, rows)
    return 0 if all(row["success"] for row in rows) else 6


def _run(scenario: str, sets: Sequence[Changes], options: argparse.Namespace) -> list[Row]:
    """Return all runs, in order: each set with each seed, with a line of progress. Raises HilError."""
    count = len(sets) * options.seeds
    began = time.monotonic()
    rows: dict[int, Row] = {}
    line, ended = ProgressLine(at_once=True), threading.Event()

    def watch() -> None:
        while not ended.wait(UPDATE_S):
            if (share := progress.share()) >= LEAST_SHARE:
                left_s = (time.monotonic() - began) * (1.0 / share - 1.0)
                line.show(f"{len(rows)}/{count} runs, {share:.0%}, {left_s:.0f} s left")
        line.clear()

    with ScratchFolder("campaign") as folder:
        progress = RunProgress(folder.file("progress"), count)
        watcher = threading.Thread(target=watch)
        with ctrl_c_held_back():  # or this thread would get it while the workers are started
            watcher.start()
        interrupted = False
        try:
            with closing(run_all(scenario, sets, options.seeds, options.jobs, progress)) as results:
                rows.update(results)
        except KeyboardInterrupt:
            interrupted = True
            raise
        finally:
            ended.set()
            watcher.join()
            if interrupted:
                print(f"ended after {len(rows)} of {count} runs; their results are discarded", file=sys.stderr)
    return [row for _, row in sorted(rows.items())]


def summary(rows: list[Row], sets: list[Changes]) -> str:
    """Return a line for each parameter set: the number of successes, and the number of runs with each kind of event.

    It ends with mean and standard deviation of each figure over the successes.
    """
    seen = [kind for kind in KINDS if any(row.get(kind) for row in rows)]
    header = ["", "success", *[name.replace("_", " ") for name in (*seen, *METRICS)]]
    lines = [header, *[_line(changes, [r for r in rows if changes.items() <= r.items()], seen) for changes in sets]]
    reasons = sorted({row["reason"] for row in rows if not row["success"]})
    return "\n".join([*aligned(lines, right=True), *(f"no success: {reason}" for reason in reasons)])


def _line(changes: Changes, rows: list[Row], kinds: Sequence[str]) -> list[str]:
    reached = [row for row in rows if row["success"]]
    runs_with = [str(sum(bool(row.get(kind)) for row in rows)) for kind in kinds]
    name = " ".join(f"{key}={value}" for key, value in changes.items()) or "all"
    spreads = [_mean_text([row[metric] for row in reached if math.isfinite(row[metric])]) for metric in METRICS]
    return [name, f"{len(reached)}/{len(rows)}", *runs_with, *spreads]


def _mean_text(values: list[float]) -> str:
    if not values:
        return "-"
    return f"{statistics.fmean(values):.3f} +- {statistics.stdev(values) if len(values) > 1 else 0.0:.3f}"
