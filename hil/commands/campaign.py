"""`uuv-hil campaign`: many runs of a mission in simulated time, with other seeds and parameters, on all cores."""

import csv
import itertools
import statistics
import sys
import time
from contextlib import AbstractContextManager, nullcontext
from importlib import import_module
from typing import Any

from hil.bench.record import check_writable
from hil.cases.simulated import fly
from hil.columns import aligned
from hil.commands.parser import new_parser
from hil.config import load_scenario
from hil.errors import ConfigError, HilError, MissingExtraError
from hil.master.flight import prepare
from hil.stop import every_end_like_ctrl_c
from hil.tables import value_of

EXAMPLES = """\
Every combination of the values given with --vary is run with every seed. A key is written as in the
scenario file, with dots for sections; a value as in TOML, or as plain text.

examples:
  uuv-hil campaign paper_field --seeds 20
  uuv-hil campaign paper_field --seeds 10 --vary master.speed=0.5,0.7,0.9 -o speeds.csv
  uuv-hil campaign paper_field --vary sensors.odometry.horizontal.bias=0.1,0.5,1.0 --seeds 5

joblib runs it. With dask or ray installed, `--backend dask` sends the runs to the cluster that
DASK_SCHEDULER_ADDRESS names (else one on this machine), `--backend ray` to the one of RAY_ADDRESS.
"""
_CLUSTERS = {"dask": "'dask[distributed]'", "ray": "ray"}
METRICS = ("duration", "travelled", "goal_error", "cross_track_max", "least_clearance")

Changes = dict[str, Any]
Row = dict[str, Any]


def main(arguments: list[str]) -> int:
    """Run the campaign; 0 when every run reached its goal, else 6."""
    parser = new_parser("campaign", __doc__, EXAMPLES)
    parser.add_argument("scenario", metavar="SCENARIO")
    parser.add_argument("--seeds", type=int, default=10, metavar="N", help="seeds 1 to N [%(default)s]")
    parser.add_argument("--vary", action="append", default=[], metavar="KEY=A,B,...", help="may be given several times")
    parser.add_argument("--jobs", type=int, default=-1, metavar="N", help="processes at once [all cores]")
    parser.add_argument("--backend", default="loky", help="joblib's: loky, threading, dask, ray [%(default)s]")
    parser.add_argument("-o", "--output", metavar="FILE.csv", help="a row a run")
    options = parser.parse_args(arguments)
    sets = combinations(options.vary)
    for changes in sets:  # a wrong key shall not cost a campaign
        load_scenario(options.scenario, changes)
    if options.output:
        check_writable(options.output)
    tasks = [(options.scenario, changes, seed) for changes in sets for seed in range(1, options.seeds + 1)]
    with every_end_like_ctrl_c():
        rows = run_all(tasks, options.jobs, options.backend)
    print(summary(rows, sets), flush=True)
    if options.output:
        write_csv(options.output, rows)
    return 0 if all(row["reached"] for row in rows) else 6


def combinations(vary: list[str]) -> list[Changes]:
    """Every combination of the values in ["key=a,b", ...]; [{}] if there are none. Raises ConfigError."""
    axes = []
    for text in vary:
        key, equals, values = text.partition("=")
        if not equals or not key or not values:
            raise ConfigError(f"--vary {text!r} is not of the form KEY=VALUE,VALUE, for example master.speed=0.5,0.8")
        axes.append([(key, value_of(value)) for value in values.split(",")])
    return [dict(choice) for choice in itertools.product(*axes)]


def run_one(scenario_name: str, changes: Changes, seed: int) -> Row:
    """One run: its parameters, its outcome, and why it failed if it did. Never raises an error of ours."""
    row: Row = {**changes, "seed": seed, "reached": False, "reason": ""}
    try:
        scenario = load_scenario(scenario_name, {**changes, "seed": seed})
        outcome, _ = fly(scenario, prepare(scenario))
    except HilError as error:
        return row | {"reason": str(error)}
    figures = {name: getattr(outcome, name) for name in METRICS}
    return row | {"reached": outcome.reached, "reason": outcome.reason, **figures}


def run_all(tasks: list[tuple[str, Changes, int]], jobs: int, backend: str) -> list[Row]:
    """All runs, in order, with a line of progress. Raises MissingExtraError, ConfigError."""
    try:
        import joblib
    except ImportError:
        raise MissingExtraError("a campaign needs joblib: pip install 'uuv-hil[master]'") from None
    began = time.monotonic()
    rows: dict[int, Row] = {}
    with _cluster(backend):
        try:
            chosen = joblib.parallel_config(backend=backend, n_jobs=jobs)
        except ValueError as error:
            raise ConfigError(f"--backend {backend!r}: {error}") from None
        runs = [joblib.delayed(_numbered)(*task) for task in enumerate(tasks)]
        with chosen:
            done = joblib.Parallel(return_as="generator_unordered")(runs)
        for place, row in done:
            rows[place] = row
            left = (time.monotonic() - began) / len(rows) * (len(tasks) - len(rows))
            print(f"\r{len(rows)}/{len(tasks)} runs, {left:.0f} s left ", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    return [rows[place] for place in range(len(tasks))]


def _numbered(place: int, task: tuple[str, Changes, int]) -> tuple[int, Row]:
    return place, run_one(*task)


def _cluster(backend: str) -> AbstractContextManager[Any]:
    """What has to be open while runs go to a cluster. Raises MissingExtraError."""
    try:
        if backend == "dask":
            client: AbstractContextManager[Any] = import_module("distributed").Client()
            return client
        if backend == "ray":
            import_module("ray.util.joblib").register_ray()
    except ImportError:
        raise MissingExtraError(f"--backend {backend} needs its package: pip install {_CLUSTERS[backend]}") from None
    return nullcontext()


def write_csv(path: str, rows: list[Row]) -> None:
    """A row a run. Raises ConfigError if the file cannot be written."""
    columns = list(dict.fromkeys(key for row in rows for key in row))
    try:
        with open(path, "w", newline="") as file:
            writer = csv.DictWriter(file, columns)
            writer.writeheader()
            writer.writerows(rows)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written: {error.strerror}") from None


def summary(rows: list[Row], sets: list[Changes]) -> str:
    """A line a parameter set: how many runs reached the goal, mean and standard deviation of each figure."""
    header = ["", "reached", *METRICS]
    lines = [header, *[_line(changes, [r for r in rows if changes.items() <= r.items()]) for changes in sets]]
    reasons = sorted({row["reason"] for row in rows if not row["reached"]})
    return "\n".join([*aligned(lines, right=True), *(f"not reached: {reason}" for reason in reasons)])


def _line(changes: Changes, rows: list[Row]) -> list[str]:
    reached = [row for row in rows if row["reached"]]
    name = " ".join(f"{key}={value}" for key, value in changes.items()) or "all"
    return [name, f"{len(reached)}/{len(rows)}", *[_spread([row[metric] for row in reached]) for metric in METRICS]]


def _spread(values: list[float]) -> str:
    if not values:
        return "-"
    return f"{statistics.fmean(values):.3f} +- {statistics.stdev(values) if len(values) > 1 else 0.0:.3f}"
