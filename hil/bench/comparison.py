"""Which differences between two results are real: bootstrap intervals of the ratio of medians."""

from math import isfinite
from typing import Literal, NamedTuple

from hil.bench.record import Better, Figure, Record
from hil.bench.statistics import Interval, median_interval, ratio_interval

FEWEST = 5  # values on each side; of fewer, intervals are as narrow as chance wants
Verdict = Literal["same", "better", "worse", "changed", "too few"]


class Difference(NamedTuple):
    """One figure in both results. `ratio` is after / before; `interval` is where that lies.

    "same" also stands for a real difference that is smaller than what was asked to matter.
    """

    name: str
    unit: str
    before: float
    after: float
    ratio: float
    interval: Interval
    verdict: Verdict


def compare(before: Record, after: Record, least: float = 0.05, confidence: float = 0.95) -> list[Difference]:
    """The figures that both have, in the order of the first. `least`: the relative difference that begins to matter."""
    common = [name for name in before.figures if name in after.figures]
    return [difference(name, before.figures[name], after.figures[name], least, confidence) for name in common]


def difference(name: str, before: Figure, after: Figure, least: float, confidence: float) -> Difference:
    """One figure, judged: real if the interval of the ratio leaves out 1, and if the ratio is off by `least`."""
    old, new = before.median, after.median
    ratio = new / old if old else float("nan")
    interval = ratio_interval(before.values, after.values, confidence)
    verdict = _judge(before, after, ratio, interval, least, confidence)
    return Difference(name, before.unit, old, new, ratio, interval, verdict)


def unlike(before: Record, after: Record) -> list[str]:
    """What makes the two hard to compare: another machine, other labels, other settings."""
    found = []
    if before.kind != after.kind:
        found.append(f"results of different benchmarks: {before.kind} and {after.kind}")
    for key in ("name", "cpu", "cores", "kernel", "python"):
        pair = before.machine.get(key), after.machine.get(key)
        if pair[0] != pair[1]:
            found.append(f"{key} of the machine: {pair[0]} and {pair[1]}")
    if before.labels != after.labels:
        found.append(f"labels: {', '.join(before.labels) or 'none'} and {', '.join(after.labels) or 'none'}")
    if before.settings != after.settings:
        keys = sorted(
            key for key in {*before.settings, *after.settings} if before.settings.get(key) != after.settings.get(key)
        )
        found.append(f"settings differ: {', '.join(keys)}")
    return found


def _judge(before: Figure, after: Figure, ratio: float, interval: Interval, least: float, confidence: float) -> Verdict:
    if min(len(before.values), len(after.values)) < FEWEST:
        return "too few"
    if not isfinite(interval.low):  # a median of 0 on the way: the values themselves are compared
        apart = _apart(median_interval(before.values, confidence), median_interval(after.values, confidence))
        return _direction(before.better, after.median > before.median) if apart else "same"
    if interval.holds(1.0) or abs(ratio - 1.0) < least:
        return "same"
    return _direction(before.better, ratio > 1.0)


def _apart(one: Interval, other: Interval) -> bool:
    return one.high < other.low or other.high < one.low


def _direction(better: Better, grown: bool) -> Verdict:
    if not better:
        return "changed"
    return "better" if grown == (better == "higher") else "worse"
