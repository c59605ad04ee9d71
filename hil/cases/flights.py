"""Run a case several times: simulated flights in parallel on all cores, flights with slaves one after the other."""

import os
import time
from collections.abc import Callable, Sequence

from hil.cases.case import find_case
from hil.cases.parallel import run_parallel
from hil.cases.record import Mode, Run
from hil.cases.viewer import Viewer
from hil.common.streams import ProgressLine
from hil.master.recorder import make_folder

Show = Callable[[str], None]


def fly_all(
    name: str,
    folder: str,
    seeds: Sequence[int],
    hil_seeds: Sequence[int] = (),
    jobs: int = -1,
    viewer: Viewer | None = None,
) -> list[Run]:
    """Fly a case with all seeds; return its flights, SIL first. Each flight has its own folder below `folder`.

    With a `viewer` the simulated flights also run one after the other.

    Raises MissingExtraError, and what `Case.fly` raises.
    """
    line = ProgressLine()
    runs = _simulate(name, folder, seeds, 1 if viewer else jobs, line, viewer)
    for number, seed in enumerate(hil_seeds, 1):
        show = _titled(line, f"{name}: HIL flight {number} of {len(hil_seeds)}")
        runs.append(fly_one(name, "hil", seed, folder, show, viewer))
    line.clear()
    return runs


def fly_one(
    name: str, mode: Mode, seed: int, folder: str, show: Show | None = None, viewer: Viewer | None = None
) -> Run:
    """Fly the case called `name` once; `show` is called with the progress as text at intervals."""
    case = find_case(name)
    if show:
        case.show = show
    if viewer:
        case.viewer = viewer
    return case.fly(mode, seed, make_folder(os.path.join(folder, f"{name}-{mode}-{seed:03}")))


def _simulate(
    name: str, folder: str, seeds: Sequence[int], jobs: int, line: ProgressLine, viewer: Viewer | None
) -> list[Run]:
    if len(seeds) == 1 or jobs == 1:
        titles = [f"{name}: SIL flight {number} of {len(seeds)}" for number in range(1, len(seeds) + 1)]
        pairs = zip(seeds, titles, strict=True)
        return [fly_one(name, "sil", seed, folder, _titled(line, title), viewer) for seed, title in pairs]
    began = time.monotonic()
    runs: dict[int, Run] = {}
    for run in run_parallel(fly_one, [(name, "sil", seed, folder) for seed in seeds], jobs):
        runs[run.result.seed] = run
        left = (time.monotonic() - began) / len(runs) * (len(seeds) - len(runs))
        line.show(f"{name}: {len(runs)} of {len(seeds)} SIL flights, {left:.0f} s left")
    return [runs[seed] for seed in seeds]


def _titled(line: ProgressLine, title: str) -> Show:
    return lambda text: line.show(f"{title}, {text}")
