"""Decide which differences between two results are significant: bootstrap intervals of the ratio of medians.

All values of one start of the programs have common conditions: the programs' place in memory, and the other work of the
machine. So a start counts as one value, its median. With few starts, single commands are resampled instead, in blocks,
because neighbours are alike. Then two starts of one program may differ too, and no difference is judged.
"""

from math import isfinite, nan
from typing import Any, Literal, NamedTuple

from hil.bench.record import Better, Figure, Record
from hil.bench.statistics import Interval, median, median_interval, ratio_interval

MIN_VALUES = 5  # values, or starts, on each side; intervals of fewer values mean nothing
A_START_A_VALUE = ("table", "startup")  # benchmarks in which every value is from a separate start
LOADED = 1.0  # a difference of the machine's load that is reported: one busy processor
Verdict = Literal["same", "better", "worse", "changed", "too few", "few starts"]


class Difference(NamedTuple):
    """One figure in both results. `ratio` is after / before; `interval` is its confidence interval.

    Both are nan if a median is not above 0: then the values are compared, not their ratio. "same" includes a real
    difference below the least that matters; "few starts" is a difference that two starts of one program may have.
    """

    name: str
    unit: str
    before: float
    after: float
    ratio: float
    interval: Interval
    verdict: Verdict


def compare(before: Record, after: Record, least: float = 0.05, confidence: float = 0.95) -> list[Difference]:
    """Return the figures that both have, in the first one's order; `least` is the relative difference that matters."""
    pairs = [(name, _figure(before, name), _figure(after, name)) for name in before.figures if name in after.figures]
    return [difference(name, old, new, least, confidence) for name, old, new in pairs]


def difference(name: str, before: Figure, after: Figure, least: float, confidence: float) -> Difference:
    """Return one figure, judged: real if the ratio's interval does not contain 1, and it differs by `least`."""
    few = min(len(before.runs), len(after.runs)) < MIN_VALUES
    sides = [figure.values if few else [median(run) for run in figure.by_run] for figure in (before, after)]
    old, new = map(median, sides)
    ratio = new / old if old > 0.0 else nan
    interval = ratio_interval(sides[0], sides[1], confidence, block=few)
    verdict: Verdict = "same"
    if min(map(len, sides)) < MIN_VALUES:
        verdict = "too few"
    elif abs(new - old) >= least * abs(old) and _apart(sides, interval, confidence, few):
        verdict = "few starts" if few else _direction(before.better, new > old)
    return Difference(name, before.unit, old, new, ratio, interval, verdict)


def different_conditions(before: Record, after: Record) -> list[str]:
    """Return the differences of the conditions: machine, its state, labels, settings."""
    differences = []
    if before.kind != after.kind:
        differences.append(f"results of different benchmarks: {before.kind} and {after.kind}")
    for key in ("name", "cpu", "cores", "usable_cores", "kernel", "python", "governors"):
        differences += _differs(f"{key} of the machine", before.machine.get(key), after.machine.get(key))
    loads = _number(before.machine.get("load")), _number(after.machine.get("load"))
    if abs(loads[0] - loads[1]) >= LOADED:
        differences.append(f"load of the machine: {loads[0]:.1f} and {loads[1]:.1f}")
    packages = _table(before.machine.get("packages")), _table(after.machine.get("packages"))
    for name in sorted({*packages[0], *packages[1]}):
        differences += _differs(name, packages[0].get(name), packages[1].get(name))
    differences += _differs("labels", ", ".join(before.labels), ", ".join(after.labels))
    keys = [key for key in {*before.settings, *after.settings} if before.settings.get(key) != after.settings.get(key)]
    return [*differences, *([f"settings differ: {', '.join(sorted(keys))}"] if keys else [])]


def _figure(record: Record, name: str) -> Figure:
    figure = record.figures[name]
    has_runs = figure.runs or record.kind not in A_START_A_VALUE
    return figure if has_runs else figure._replace(runs=(1,) * len(figure.values))


def _apart(sides: list[list[float]], interval: Interval, confidence: float, block: bool) -> bool:
    if isfinite(interval.low):
        return not interval.holds(1.0)
    one, other = (median_interval(values, confidence, block=block) for values in sides)
    return one.high < other.low or other.high < one.low


def _direction(better: Better, grown: bool) -> Verdict:
    if not better:
        return "changed"
    return "better" if grown == (better == "higher") else "worse"


def _differs(name: str, before: Any, after: Any) -> list[str]:
    return [f"{name}: {_format_value(before)} and {_format_value(after)}"] if before != after else []


def _format_value(value: Any) -> str:
    """Return a value as text; for governors, their names and counts."""
    if isinstance(value, dict):
        value = ", ".join(f"{key} ({number})" for key, number in value.items())
    return str(value or "none")


def _number(value: Any) -> float:
    """Return a value as a number; nan, which equals no other value, if it is not a number."""
    return value if isinstance(value, float) else nan


def _table(value: Any) -> dict[str, Any]:
    return value if isinstance(value, dict) else {}
