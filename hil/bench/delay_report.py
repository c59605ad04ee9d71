"""Format and draw command delays of several configurations."""

from collections.abc import Mapping
from math import isfinite
from typing import Any

from hil.bench.delay_run import HOPS, Result
from hil.bench.record import Record
from hil.bench.statistics import median
from hil.common.columns import aligned, fit_to_terminal
from hil.common.palette import SERIES
from hil.common.quantiles import quantile
from hil.plots.plotting import curve, pyplot, save_figure

SHARES = {"p50": 0.5, "p90": 0.9, "p99": 0.99, "p99.9": 0.999, "max": 1.0}
ENOUGH = 1.0  # commands beyond a quantile that is shown; with fewer the quantile is only the maximum
MAX_SHOWN = 0.98  # share of the commands of each configuration in the histogram, if the rest are far away
FAR = 2.0  # times the delay of the others
SQUEEZED = 5.0  # largest delay over the histogram's end, beyond which the time series has a logarithmic axis
BINS = 60
FEWEST_ROWS = 4  # of bars on the axis, so that a single bar is not as high as the picture


def text(results: Mapping[str, Result]) -> str:
    """Return the delays, their floors, the hops and the remarks, as text."""
    return "\n".join([*_delays(results), "", *_floors(results), "", *_hops(results), "", *_notes(results)])


def draw(results: Mapping[str, Result], record: Record, path: str) -> None:
    """Draw histograms, time series and hops; `record` has machine, date and labels.

    Raises ConfigError, MissingExtraError.
    """
    plt = pyplot()
    figure, axes = plt.subplots(1, 3, figsize=(17, 6.5 + 0.12 * len(results)), layout="constrained")
    histogram, series, hops = axes
    low, high = _range(results)
    beyond = sum(value > high for result in results.values() for value in result.delay)
    largest = max((value for result in results.values() for value in result.delay), default=high)
    for number, (name, result) in enumerate(results.items()):
        histogram.hist(result.delay, bins=BINS, range=(low, high), histtype="step", **curve(number), label=name)
        series.plot(result.at_s, result.delay, linewidth=0.8, **curve(number))
    remark = f"; {beyond} more beyond, up to {largest:.1f} ms" if beyond else ""
    histogram.set(xlabel=f"command delay (ms){remark}", ylabel="commands", xlim=(low, high), title="how often")
    series.set(xlabel="time (s)", ylabel="command delay (ms)", title="when")
    if low < 0.0 or largest <= SQUEEZED * high:
        series.set_ylim(low, None)
    else:
        series.set_yscale("log")
        series.yaxis.set_major_formatter("{x:g}")
    _draw_hops(hops, results)
    doubtful = ", with WARNINGS" if any(details["warnings"] for details in record.details.values()) else ""
    figure.suptitle(f"Command delay{doubtful}\n{record.footer}", fontsize="medium")
    figure.legend(*histogram.get_legend_handles_labels(), loc="outside lower left", fontsize="small", ncols=2)
    figure.legend(*hops.get_legend_handles_labels(), loc="outside lower right", fontsize="small", ncols=4)
    save_figure(figure, path)


def _range(results: Mapping[str, Result]) -> tuple[float, float]:
    """Return the range of the histogram: all delays, or most of them if the rest are far away."""
    delays = [sorted(result.delay) for result in results.values() if result.delay]
    high = max((values[-1] for values in delays), default=1.0)
    most = max((quantile(values, MAX_SHOWN) for values in delays), default=1.0)
    low = min((values[0] for values in delays), default=0.0)
    return min(low, 0.0), (FAR * most if 0.0 < FAR * most < high else max(high, 0.0) or 1.0)


def _draw_hops(axes: Any, results: Mapping[str, Result]) -> None:
    names = list(results)
    starts = [0.0] * len(names)
    for hop, color in zip(HOPS, SERIES, strict=True):
        widths = [median(result.hops[hop] or [0.0]) for result in results.values()]
        axes.barh(names, widths, left=starts, color=color, label=hop)
        starts = [start + width for start, width in zip(starts, widths, strict=True)]
    floors = [(result.floor, name) for name, result in results.items() if isfinite(result.floor)]
    if floors:
        axes.scatter(*zip(*floors, strict=True), marker="D", s=50, color="white", edgecolors="black", label="floor")
    axes.set(xlabel="median of each hop (ms)", title="where", ylim=(max(len(names), FEWEST_ROWS) - 0.5, -0.5))


def _delays(results: Mapping[str, Result]) -> list[str]:
    rows = [["command delay (ms)", "answered", *SHARES, "to motion"]]
    for name, result in results.items():
        quantiles = [_format_quantile(result.delay, share) for share in SHARES.values()]
        motion = f"{median(result.motion):.1f}" if result.motion else "-"
        rows.append([name, f"{len(result.delay)}/{result.sent}", *quantiles, motion])
    return aligned(rows, rule=True)


def _floors(results: Mapping[str, Result]) -> list[str]:
    rows = [["median (ms)", "floor", "above it", "bare UDP", "bare TCP"]]
    for name, result in results.items():
        numbers = [result.floor, result.at(0.5) - result.floor, median(result.udp), median(result.tcp)]
        rows.append([name, *map(_number, numbers)])
    return aligned(rows, rule=True)


def _hops(results: Mapping[str, Result]) -> list[str]:
    rows = [["median of each hop (ms)", *HOPS]]
    for name, result in results.items():
        total = median(result.delay)
        medians = [median(result.hops[hop]) for hop in HOPS]
        rows.append([name, *(f"{value:.3f} ({value / total:.0%})" if total > 0.0 else "-" for value in medians)])
    return aligned(rows, rule=True)


def _notes(results: Mapping[str, Result]) -> list[str]:
    lines = ["floor: half a round trip of bare TCP in the same seconds, and the frame's time on its line"]
    if all(not result.tcp for result in results.values()):
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
