"""Many flights of a case: those in the simulation on all cores, those with slaves one after the other."""

import os
import sys
import time
from collections.abc import Sequence

from hil.cases.case import find_case
from hil.cases.record import Mode, Run
from hil.errors import MissingExtraError
from hil.master.recorder import make_folder


def fly_all(name: str, folder: str, seeds: Sequence[int], hil_seeds: Sequence[int] = (), jobs: int = -1) -> list[Run]:
    """The flights of a case, SIL first; each leaves its files in a folder of its own below `folder`.

    Raises MissingExtraError, and what `Case.fly` raises.
    """
    runs = _simulate(name, folder, seeds, jobs)
    for number, seed in enumerate(hil_seeds, 1):
        _say(f"{name}: HIL flight {number} of {len(hil_seeds)}, in real time")
        runs.append(fly_one(name, "hil", seed, folder))
    _say("")
    return runs


def fly_one(name: str, mode: Mode, seed: int, folder: str) -> Run:
    """One flight of the case called `name`."""
    return find_case(name).fly(mode, seed, make_folder(os.path.join(folder, f"{name}-{mode}-{seed:03}")))


def _simulate(name: str, folder: str, seeds: Sequence[int], jobs: int) -> list[Run]:
    if len(seeds) == 1 or jobs == 1:
        return [fly_one(name, "sil", seed, folder) for seed in seeds]
    try:
        import joblib
    except ImportError:
        raise MissingExtraError("flights of several seeds need joblib: pip install 'uuv-hil[master]'") from None
    began = time.monotonic()
    runs: dict[int, Run] = {}
    flights = (joblib.delayed(fly_one)(name, "sil", seed, folder) for seed in seeds)
    for run in joblib.Parallel(n_jobs=jobs, return_as="generator_unordered")(flights):
        runs[run.result.seed] = run
        left = (time.monotonic() - began) / len(runs) * (len(seeds) - len(runs))
        _say(f"{name}: {len(runs)} of {len(seeds)} SIL flights, {left:.0f} s left")
    return [runs[seed] for seed in seeds]


def _say(text: str) -> None:
    if sys.stderr.isatty():
        print(f"\r\x1b[K{text}", end="", file=sys.stderr, flush=True)
    elif text.endswith("in real time"):
        print(text, file=sys.stderr, flush=True)
