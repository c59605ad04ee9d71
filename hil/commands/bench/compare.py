"""`uuv-hil bench compare`: find which differences between two results are real."""

import sys
from collections import Counter
from math import isfinite
from typing import Any

from hil.bench.comparison import MIN_VALUES, Difference, Verdict, compare, different_conditions
from hil.bench.record import load
from hil.commands.bench.options import benchmark
from hil.common.columns import aligned
from hil.common.errors import ConfigError
from hil.common.options import Share, add_json, new_parser
from hil.common.text import json_text

EXAMPLES = """\
A difference is real when the bootstrap interval of the ratio of the two medians does not contain 1. It counts starts
of the programs, because the values of one start are alike: each side needs 5 (bench delay --repeat 5). At 95 %, about
five of a hundred equal figures seem to differ. A change of the machine between the two measurements, such as other
work, looks like a difference of the programs: measure both in turn.

examples:
  uuv-hil bench compare before.json after.json
  uuv-hil bench compare main.json branch.json --fail-on-regression --least 10%     in continuous integration
"""
REGRESSION = 1
UNDECIDED: dict[Verdict, str] = {
    "too few": f"too few: fewer than {MIN_VALUES} values on a side; measure with more repetitions",
    "few starts": f"few starts: the two differ, but with fewer than {MIN_VALUES} starts on a side that may be a "
    "difference between two starts rather than two programs; measure with --repeat 5",
}


@benchmark
def main(arguments: list[str]) -> int:
    """Compare and print; return 0, or 1 with --fail-on-regression when something became worse. Raises ConfigError."""
    parser = new_parser("bench compare", __doc__, EXAMPLES)
    parser.add_argument("before", metavar="A.json", help="the result before a change")
    parser.add_argument("after", metavar="B.json", help="the result after it")
    parser.add_argument(
        "--least",
        type=Share(0.0, 0.99),
        default="5%",
        metavar="SHARE",
        help="least difference that counts [%(default)s]",
    )
    parser.add_argument(
        "--confidence",
        type=Share(0.5, 0.9999),
        default="95%",
        metavar="SHARE",
        help="confidence of the intervals [%(default)s]",
    )
    parser.add_argument(
        "--fail-on-regression", action="store_true", help="exit with code 1 when a figure is significantly worse"
    )
    add_json(parser)
    options = parser.parse_args(arguments)
    least, confidence = options.least, options.confidence
    before, after = load(options.before), load(options.after)
    differences = compare(before, after, least, confidence)
    if not differences and before.kind != after.kind:
        kinds = f"{options.before} is of `bench {before.kind}`, {options.after} of `bench {after.kind}`"
        raise ConfigError(f"{kinds}: they have no figure in common; give two results of one benchmark")
    if not differences:
        raise ConfigError(
            f"{options.before} and {options.after} have no figure in common; measure both with the same options"
        )
    warnings = different_conditions(before, after)
    print(json_text(_record(differences, warnings), indent=1) if options.json else _text(differences, confidence))
    for warning in warnings:
        print(f"different conditions: {warning}", file=sys.stderr)
    worse = any(one.verdict == "worse" for one in differences)
    return REGRESSION if worse and options.fail_on_regression else 0


def _text(differences: list[Difference], confidence: float) -> str:
    rows = [["figure", "before", "after", "ratio", f"{confidence:.0%} interval", ""]]
    for one in differences:
        interval = f"{one.interval.low:.3f} to {one.interval.high:.3f}"
        values = (f"{value:.4g} {one.unit}" for value in (one.before, one.after))
        ratio = [f"{one.ratio:.3f}", interval] if isfinite(one.interval.low) else ["-", "-"]
        rows.append([one.name, *values, *ratio, one.verdict])
    counts = Counter(one.verdict for one in differences)
    lines = [*aligned(rows, rule=True), *(text for verdict, text in UNDECIDED.items() if counts[verdict])]
    undecided = sum(counts[verdict] for verdict in UNDECIDED)
    remark = f", {undecided} undecided" if undecided else ""
    return "\n".join([*lines, f"{counts['worse']} worse, {counts['better']} better{remark}, of {len(differences)}"])


def _record(differences: list[Difference], warnings: list[str]) -> Any:
    rows = [one._asdict() | {"interval": list(one.interval)} for one in differences]
    return {"differences": rows, "not_alike": warnings}
