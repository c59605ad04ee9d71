"""Command delays of several configurations, for people."""

from collections.abc import Mapping
from typing import Any

from hil.bench.delay_run import HOPS, Result
from hil.bench.plotting import pyplot
from hil.bench.statistics import median, quantile
from hil.columns import aligned
from hil.errors import ConfigError

SHARES = {"p50": 0.5, "p90": 0.9, "p99": 0.99, "p99.9": 0.999, "max": 1.0}
ENOUGH = 1.0  # commands beyond a quantile, or it is only the maximum
COLORS = ("#1e3a8a", "#1d4ed8", "#60a5fa", "#f59e0b", "#facc15", "#9ca3af", "#c2410c")


def text(results: Mapping[str, Result]) -> str:
    """Delays beside their floor, then the hops, then what is to be known."""
    return "\n".join([*_delays(results), "", *_hops(results), "", *_notes(results)])


def draw(results: Mapping[str, Result], path: str) -> None:
    """Histograms, time series and hops. Raises ConfigError, MissingExtraError."""
    plt = pyplot()
    figure, axes = plt.subplots(1, 3, figsize=(17, 5.5), layout="constrained")
    histogram, series, hops = axes
    for name, result in results.items():
        histogram.hist(result.delay, bins=60, histtype="step", label=name)
        series.plot(result.at_s, result.delay, linewidth=0.8, label=name)
    histogram.set(xlabel="command delay (ms)", ylabel="commands", xlim=(0, None))
    series.set(xlabel="time (s)", ylabel="command delay (ms)", ylim=(0, None))
    _draw_hops(hops, results)
    histogram.legend(fontsize="small")
    try:
        figure.savefig(path, dpi=110)
    except (OSError, ValueError) as error:
        raise ConfigError(f"{path}: cannot be written: {error}") from None
    finally:
        plt.close(figure)


def _draw_hops(axes: Any, results: Mapping[str, Result]) -> None:
    names = list(results)
    starts = [0.0] * len(names)
    for hop, color in zip(HOPS, COLORS, strict=True):
        widths = [_median(result.hops[hop]) for result in results.values()]
        axes.barh(names, widths, left=starts, color=color, label=hop)
        starts = [start + width for start, width in zip(starts, widths, strict=True)]
    axes.scatter([result.floor for result in results.values()], names, marker="|", s=400, color="black", label="floor")
    axes.set(xlabel="median of each hop (ms)")
    axes.invert_yaxis()
    axes.legend(fontsize="small")


def _delays(results: Mapping[str, Result]) -> list[str]:
    head = ["command delay (ms)", "answered", *SHARES, "floor", "above it", "bare UDP", "bare TCP", "to motion"]
    rows = [head]
    for name, result in results.items():
        quantiles = [_quantile(result.delay, share) for share in SHARES.values()]
        bare = [f"{_median(values):.3f}" for values in (result.udp, result.tcp)]
        above = result.at(0.5) - result.floor
        answered = f"{len(result.delay)}/{result.sent}"
        motion = f"{median(result.motion):.1f}" if result.motion else "-"
        rows.append([name, answered, *quantiles, f"{result.floor:.3f}", f"{above:.3f}", *bare, motion])
    return aligned(rows, rule=True)


def _hops(results: Mapping[str, Result]) -> list[str]:
    rows = [["median of each hop (ms)", *HOPS]]
    for name, result in results.items():
        total = median(result.delay)
        medians = [median(result.hops[hop]) for hop in HOPS]
        rows.append([name, *(f"{value:.3f} ({value / total:.0%})" if total else "-" for value in medians)])
    return aligned(rows, rule=True)


def _notes(results: Mapping[str, Result]) -> list[str]:
    lines = ["floor: half a round trip of bare TCP in the same seconds, and the frame's time on its line"]
    for name, result in results.items():
        if result.clock_uncertainty:
            lines.append(
                f"{name}: two clocks, {result.clock_offset:.3f} ms apart, known to +-{result.clock_uncertainty:.3f} ms"
            )
        lines += [f"WARNING, {name}: {warning}" for warning in result.warnings]
    return lines


def _quantile(values: list[float], share: float) -> str:
    if share < 1.0 and len(values) * (1.0 - share) < ENOUGH:
        return "-"
    return f"{quantile(sorted(values), share):.3f}"


def _median(values: list[float]) -> float:
    return median(values) if values else 0.0
