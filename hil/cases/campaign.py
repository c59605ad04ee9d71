"""A campaign: every combination of values with every seed; a row of parameters and outcome for each."""

import itertools
import math
import os
from collections.abc import Callable, Generator, Sequence
from functools import partial
from typing import Any

from hil.cases.parallel import run_parallel
from hil.cases.simulated import fly, progress_watch
from hil.common.errors import ConfigError, HilError
from hil.common.plugins import own_traceback
from hil.common.schema import shortened
from hil.common.tables import value_of
from hil.master.flight import prepare
from hil.scenario.config import load_scenario
from sim.run_events import KINDS

MAX_COMBINATIONS = 10_000
Changes = dict[str, Any]
Row = dict[str, Any]
METRICS = ("duration", "travelled", "goal_error", "cross_track_max", "least_clearance")


def combinations(vary: list[str]) -> list[Changes]:
    """Return every combination of the values in ["key=a,b", ...]; [{}] if there are none. Raises ConfigError."""
    axes = []
    for text in vary:
        key, equals, values = text.partition("=")
        if not equals or not key or not values:
            raise ConfigError(f"--vary {text!r} is not of the form KEY=VALUE,VALUE, for example master.speed=0.5,0.8")
        axes.append([(key, value_of(value)) for value in values.split(",")])
    count = math.prod(map(len, axes))
    if count > MAX_COMBINATIONS:
        sizes = " x ".join([f"{len(axis)} of {shortened(axis[0][0])}" for axis in axes])
        raise ConfigError(
            f"--vary: {sizes} make {count} combinations, and a campaign has at most {MAX_COMBINATIONS}: give fewer "
            "values, or several campaigns"
        )
    return [dict(choice) for choice in itertools.product(*axes)]


class RunProgress:
    """How far the runs of a campaign are: a byte in a file for each, in per cent, which its worker writes."""

    def __init__(self, path: str, runs: int) -> None:
        self._path, self._runs = path, runs
        with open(path, "wb") as file:
            file.truncate(runs)

    def share(self) -> float:
        """Return how much of all runs is flown, 0 to 1."""
        with open(self._path, "rb") as file:
            return sum(file.read()) / (100.0 * self._runs)

    def write(self, number: int, share: float) -> None:
        """Write how much of a run is flown, 0 to 1."""
        with open(self._path, "r+b") as file:
            file.seek(number)
            file.write(bytes([round(100.0 * min(max(share, 0.0), 1.0))]))


def run_one(scenario_name: str, changes: Changes, seed: int, note: Callable[[float], None]) -> Row:
    """Run once; return parameters and outcome, with the reason of a failure. Raises no HilError.

    `note` is called with how much is flown, 0 to 1.
    """
    row: Row = {**changes, "seed": seed, "success": False, "reached": False, "reason": ""}
    try:
        scenario = load_scenario(scenario_name, {**changes, "seed": seed}, option="--set or --vary")
        plan = prepare(scenario)
        outcome, _ = fly(scenario, plan, watches=[progress_watch(plan.planner, lambda _: note(plan.planner.progress))])
    except HilError as error:
        return row | {"reason": str(error)}
    except Exception as error:  # from a user's planner; other seeds may not cause it
        own = own_traceback(error)
        if own is None:
            raise
        location = f"{os.path.basename(own.tb_frame.f_code.co_filename)}:{own.tb_lineno}"
        return row | {"reason": f"{location}: {type(error).__name__}: {error}"}
    figures = {name: getattr(outcome, name) for name in METRICS}
    counts = {kind: sum(event.kind == kind for event in outcome.events) for kind in KINDS}
    result = {"success": outcome.success, "reached": outcome.reached, "reason": outcome.verdict}
    return row | result | figures | counts | {"events": "; ".join([event.describe() for event in outcome.events])}


def run_all(
    scenario: str, sets: Sequence[Changes], seeds: int, jobs: int, progress: RunProgress
) -> Generator[tuple[int, Row], None, None]:
    """Run each set with each seed; yield the number of each run and its row, as it ends. Raises MissingExtraError."""
    pairs = enumerate(itertools.product(sets, range(1, seeds + 1)))
    return run_parallel(_run_numbered, [(progress, number, scenario, *pair) for number, pair in pairs], jobs)


def _run_numbered(progress: RunProgress, number: int, scenario: str, changes: Changes, seed: int) -> tuple[int, Row]:
    row = run_one(scenario, changes, seed, partial(progress.write, number))
    progress.write(number, 1.0)
    return number, row
