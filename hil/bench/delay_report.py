"""Show command delays of several configurations as text."""

from collections.abc import Mapping
from math import isfinite

from hil.bench.delay_run import HOPS, Result
from hil.bench.report import Row
from hil.common.columns import aligned, fit_to_terminal
from hil.common.quantiles import quantile

SHARES = {"p50": 0.5, "p90": 0.9, "p99": 0.99, "p99.9": 0.999, "max": 1.0}
ENOUGH = 1.0  # commands beyond a quantile that is shown; with fewer the quantile is only the maximum
FLOORS = ("udp floor", "tcp floor", "hop wire")  # which depend on the machine alone: a lower one is not "better"
ROWS = [Row(name, name, "ms", "{:.3f}") for name in ("delay", "motion", *(f"hop {hop}" for hop in HOPS))]  # drawn


def text(results: Mapping[str, Result]) -> str:
    """Return the delays, their floors, the hops and the remarks, as text."""
    return "\n".join([*_delays(results), "", *_floors(results), "", *_hops(results), "", *_notes(results)])


def _delays(results: Mapping[str, Result]) -> list[str]:
    rows = [["command delay (ms)", "answered", *SHARES, "to motion"]]
    for name, result in results.items():
        quantiles = [_format_quantile(result.values["delay"], share) for share in SHARES.values()]
        motion = f"{result.middle('motion'):.1f}" if result.values["motion"] else "-"
        rows.append([name, f"{len(result.values['delay'])}/{result.sent}", *quantiles, motion])
    return aligned(rows, rule=True)


def _floors(results: Mapping[str, Result]) -> list[str]:
    rows = [["median (ms)", "floor", "above it", "bare UDP", "bare TCP"]]
    for name, result in results.items():
        numbers = [result.floor, result.at(0.5) - result.floor, result.middle("udp floor"), result.middle("tcp floor")]
        rows.append([name, *map(_number, numbers)])
    return aligned(rows, rule=True)


def _hops(results: Mapping[str, Result]) -> list[str]:
    rows = [["median of each hop (ms)", *HOPS]]
    for name, result in results.items():
        total = result.middle("delay")
        medians = [result.middle(f"hop {hop}") for hop in HOPS]
        rows.append([name, *(f"{value:.3f} ({value / total:.0%})" if total > 0.0 else "-" for value in medians)])
    return aligned(rows, rule=True)


def _notes(results: Mapping[str, Result]) -> list[str]:
    lines = ["floor: half a round trip of bare TCP in the same seconds, and the frame's time on its line"]
    if not any(result.values["tcp floor"] for result in results.values()):
        lines = ["no floor: let `uuv-hil bench echo` run beside the slave, and name its output with --echo"]
    for name, result in results.items():
        if result.clock_uncertainty:
            lines.append(
                f"{name}: two clocks, {result.clock_offset:.3f} ms apart, known to +-{result.clock_uncertainty:.3f} ms"
            )
        lines += [f"WARNING, {name}: {warning}" for warning in result.warnings]
    return [fit_to_terminal(line) for line in lines]


def _format_quantile(values: list[float], share: float) -> str:
    enough = share == 1.0 or len(values) * (1.0 - share) >= ENOUGH
    return _number(quantile(sorted(values), share)) if enough else "-"


def _number(value: float) -> str:
    return f"{value:.3f}" if isfinite(value) else "-"
