"""Plan of the campaign: which faults are applied to which links, and which of them share processes."""

import tempfile
from collections.abc import Callable, Iterator
from math import nan
from pathlib import Path
from typing import NamedTuple

from hil.common.errors import HilError
from tools.faults.kinds import address, driver, line, machine, network, peer
from tools.faults.kinds.file import BAD_FILES, BadFile, measure_file
from tools.faults.links import LINKS, Link
from tools.faults.measure import measure
from tools.faults.rig import Rig
from tools.faults.rows import Fault, Row

QUICK_FILES = 2
QUICK_LINKS = LINKS[:1]


class Group(NamedTuple):
    """Faults for one rig, one after another.

    The rig has a relay if `network`, a small disk if `disk`, and two machines if `spaces`.
    """

    faults: tuple[Fault, ...]
    network: bool = False
    disk: bool = False
    spaces: bool = False


GROUPS = (
    Group(line.FAULTS),
    Group(driver.FAULTS),
    Group(network.FAULTS, network=True),
    Group(machine.FAULTS, disk=True),
    Group(peer.FAULTS),
    Group(address.FAULTS, spaces=True),
)
Choose = Callable[[str], bool]


class Plan(NamedTuple):
    """Part of the campaign: a link, the faults that are applied to it, and their group."""

    link: Link
    faults: tuple[Fault, ...]
    group: Group


def plans(choose: Choose, thorough: bool, quick: bool) -> list[Plan]:
    """Return the plans with the rows that `choose` accepts by name, "room fault link"."""
    plans = []
    for group in GROUPS:
        for link in LINKS:
            if (link.thorough and not thorough) or (quick and link not in QUICK_LINKS):
                continue
            faults = [f for f in group.faults if link in f.links and (f.quick or not quick)]
            faults = [f for f in faults if choose(f"{f.room} {f.name} {link.name}")]
            if faults:
                plans.append(Plan(link, tuple(faults), group))
    return plans


def bad_files(choose: Choose, quick: bool) -> tuple[BadFile, ...]:
    """Return the files that `choose` accepts by name."""
    return tuple(bad for bad in BAD_FILES[: QUICK_FILES if quick else None] if choose(f"file {bad.name}"))


def run_plan(plan: Plan, attempts: int = 1) -> Iterator[Row]:
    """Yield the rows of a plan; a row that fails is measured up to `attempts` times, in a new rig each time."""
    remaining, attempt = list(plan.faults), 1
    while remaining:
        with tempfile.TemporaryDirectory(prefix="uuv-hil-faults-") as name:
            folder = Path(name)
            sections = machine.RECORDING.format(disk=folder / "disk") if plan.group.disk else ""
            with Rig(plan.link, folder, plan.group.network, sections, spaces=plan.group.spaces) as rig:
                if plan.group.disk:
                    machine.prepare(rig)
                try:
                    rig.start()
                except (HilError, OSError) as error:
                    fault = remaining.pop(0)
                    yield _not_measured(fault, plan.link, f"the processes did not start: {error}")
                    continue
                while remaining:
                    row = _measure(rig, remaining[0])._replace(attempts=attempt)
                    if row.passed or attempt >= attempts:
                        yield row
                        remaining.pop(0)
                        attempt = 1
                    else:
                        attempt += 1
                    if not row.passed:
                        break


def run_files(files: tuple[BadFile, ...]) -> Iterator[Row]:
    """Yield the rows of broken files."""
    with tempfile.TemporaryDirectory(prefix="uuv-hil-faults-") as folder:
        for bad in files:
            yield measure_file(bad, Path(folder))


def _measure(rig: Rig, fault: Fault) -> Row:
    unavailable = fault.unavailable(rig)
    if unavailable:
        return _not_measured(fault, rig.link, "", f"not run: {unavailable}")
    return measure(rig, fault)


def _not_measured(fault: Fault, link: Link, problem: str, reported: str = "") -> Row:
    return Row(fault.room, fault.name, link.name, nan, nan, nan, 0, reported, "", (problem,) if problem else ())
