"""Draw the figures of a recorded run: trajectory, depth, commands and response, thrusters, delays."""

import os
from collections.abc import Sequence
from math import nan
from typing import Any

from hil.client.delay import HOPS, quantiles
from hil.common.errors import ConfigError
from hil.common.palette import COMMANDED, NAVIGATION, OBSTACLE, SERIES, TETHER, TRACK
from hil.plots.plotting import add_legend, curve, fit_map, pyplot, save_figure
from hil.plots.run_data import Row, VehicleData, collect
from hil.plots.run_picture import draw_depths, draw_events, draw_goal, draw_world
from hil.recording.reader import read_about, read_messages
from hil.recording.run import Run, read_run

GAP_S = 1.0  # a longer time without samples interrupts a line
RESPONSE = (("surge (m/s)", 1, 5), ("sway (m/s)", 2, 6), ("heave (m/s)", 3, 7), ("yaw rate (rad/s)", 4, 8))


def plot_recording(path: str, folder: str, own_classes: bool = False) -> list[str]:
    """Draw the figures of the recording at `path` into `folder`; return their files.

    `own_classes`: see `read_run`. Raises ConfigError, MissingExtraError.
    """
    plt = pyplot()
    about = read_about(path)
    run = read_run(about, path, own_classes)
    vehicles = collect(read_messages(path), path)
    if not vehicles:
        raise ConfigError(f"{path}: has no vehicle with positions, commands or delays: there is nothing to draw")
    for data in vehicles.values():
        recorder = about.facts.get("boot_id", "")
        data.delays.same_clock = not (recorder and data.boot_id and recorder != data.boot_id)
    figures = {"trajectory": _trajectory(plt, vehicles, run)}
    for node, data in vehicles.items():
        suffix = f"-{node}" if len(vehicles) > 1 else ""
        figures |= {name + suffix: figure for name, figure in _figures(plt, node, data, run)}
    try:
        os.makedirs(folder, exist_ok=True)
        return [save_figure(figure, os.path.join(folder, f"{name}.png")) for name, figure in figures.items() if figure]
    except OSError as error:
        raise ConfigError(f"{folder}: cannot be written: {error.strerror}; choose another folder with -o") from None
    finally:
        plt.close("all")


def _figures(plt: Any, node: str, data: VehicleData, run: Run | None) -> list[tuple[str, Any]]:
    return [
        ("depth", _depth(plt, node, data, run) if data.true or data.measured else None),
        ("commands", _commands(plt, node, data) if data.commands else None),
        ("thrusters", _thrusters(plt, node, data, run) if data.pulses else None),
        ("delays", _delays(plt, node, data) if len(data.delays) else None),
    ]


def _trajectory(plt: Any, vehicles: dict[str, VehicleData], run: Run | None) -> Any:
    """Draw the trajectories from above; return None if no vehicle reports its position."""
    if not any(data.true or data.measured for data in vehicles.values()):
        return None
    figure, axes = plt.subplots(figsize=(10, 8), layout="constrained")
    if run:
        draw_world(axes, run.world)
        draw_goal(axes, run.scenario)
    places: list[Sequence[float]] = [(0.0, *place) for place in run.scenario.master.places()] if run else []
    for number, (node, data) in enumerate(vehicles.items()):
        rows = data.true or data.measured
        if not rows:
            continue
        alone = len(vehicles) == 1
        if data.true and data.measured and alone:
            axes.plot(_column(data.measured, 2), _column(data.measured, 1), color=NAVIGATION, linewidth=2.5,
                      label="odometry")  # fmt: skip
        style = {"color": TRACK} if alone else curve(number)
        label = node if not alone else f"{node} (true)" if data.true else node
        axes.plot(_column(rows, 2), _column(rows, 1), **style, linewidth=2.0, label=label)
        for end, marker, name in ((rows[0], "o", "start"), (rows[-1], "s", "end")):
            axes.plot(end[2], end[1], marker, color=style["color"], markersize=7, markeredgecolor="black", label=name)
        places += rows
        if data.tether:
            axes.plot(_column(data.tether, 1), _column(data.tether, 0), color=TETHER, linewidth=1.3,
                      label="tether at the end")  # fmt: skip
    draw_events(axes, [event for data in vehicles.values() for event in data.events])
    named = (run.scenario.description or f"{run.vehicle.name} in {run.world.name}") if run else "trajectory"
    axes.set(title=named)
    fit_map(axes, _column(places, 2), _column(places, 1))
    return figure


def _depth(plt: Any, node: str, data: VehicleData, run: Run | None) -> Any:
    figure, axes = plt.subplots(figsize=(10, 4), layout="constrained")
    if data.measured:
        _line(axes, data.measured, 3, color=NAVIGATION, linewidth=2.5, label="odometry")
    if data.true:
        _line(axes, data.true, 3, color=TRACK, linewidth=1.3, label="true")
    if run:
        draw_depths(axes, run.scenario)
    low, high = axes.get_ylim()
    if high - low < 0.2:  # at least 0.2 m, so that a tiny change does not look like a dive
        axes.set_ylim(0.5 * (low + high) - 0.1, 0.5 * (low + high) + 0.1)
    axes.invert_yaxis()
    _finish(axes, "depth (m)")
    axes.set(xlabel="time (s)", title=f"{node}: depth")
    return figure


def _commands(plt: Any, node: str, data: VehicleData) -> Any:
    """Return a figure of each commanded velocity and the true one."""
    figure, panels = plt.subplots(4, 1, figsize=(11, 9), sharex=True, layout="constrained")
    response = data.true or data.measured
    for axes, (label, commanded, true) in zip(panels, RESPONSE, strict=True):
        _line(axes, data.commands, commanded, color=COMMANDED, drawstyle="steps-post", label="commanded")
        if response:
            _line(axes, response, true, color=TRACK, label="true" if data.true else "odometry")
        _finish(axes, label)
    panels[-1].set_xlabel("time (s)")
    panels[0].set_title(f"{node}: commands and response, along the body's axes (z down)")
    return figure


def _thrusters(plt: Any, node: str, data: VehicleData, run: Run | None) -> Any:
    """Return a figure of the pulse widths, with one panel per channel."""
    count = len(data.pulses[0]) - 1
    names = run.vehicle.channels if run else data.channels
    if len(names) != count:
        names = tuple(f"channel {number}" for number in range(1, count + 1))
    figure, panels = plt.subplots(
        count, 1, figsize=(9, 1.4 + 1.25 * count), sharex=True, sharey=True, squeeze=False, layout="constrained"
    )
    for number, (axes, name) in enumerate(zip(panels[:, 0], names, strict=True), 1):
        _line(axes, data.pulses, number, color=TRACK, linewidth=1.0, drawstyle="steps-post")
        axes.axhline(1500, color="0.6", linewidth=0.8, linestyle="--")
        axes.set_ylabel(name.replace("_", "\n"), fontsize=9)
    panels[0, 0].set_title(f"{node}: pulses of the thrusters (µs; dashed: neutral)")
    panels[-1, 0].set_xlabel("time (s)")
    return figure


def _delays(plt: Any, node: str, data: VehicleData) -> Any:
    """Return a figure of the hops' delays over time, stacked, and of the distribution of the total."""
    figure, (over_time, histogram) = plt.subplots(
        1, 2, figsize=(11, 4.5), width_ratios=(2, 1), sharey=True, layout="constrained"
    )
    hops = [[max(value, 0) / 1e6 for value in data.delays.hop_ns(hop)] for hop in range(len(HOPS))]
    times, hops = with_gaps(data.traced, hops)
    over_time.stackplot(times, hops, labels=HOPS, colors=SERIES)
    totals = data.delays.totals_ns()
    summary = quantiles(totals)
    over_time.set(
        xlabel="time (s)",
        ylabel="delay of a command (ms)",
        title=f"{node}: delay from publishing to the thrusters",
    )
    over_time.set_ylim(0.0, max(1.25 * summary.p99_ms, 0.01))
    figure.legend(loc="outside lower center", fontsize=9, ncols=len(HOPS))
    histogram.hist([total / 1e6 for total in totals], bins=60, range=(0.0, max(1.25 * summary.p99_ms, 0.01)),
                orientation="horizontal", color=OBSTACLE)  # fmt: skip
    for share, value in (("median", summary.p50_ms), ("99 %", summary.p99_ms)):
        histogram.axhline(value, color="black", linewidth=0.9, linestyle="--")
        histogram.annotate(f"{share}: {value:.2f} ms", (0.98, value), xycoords=("axes fraction", "data"), fontsize=9,
                        xytext=(0, 6), textcoords="offset points", ha="right",
                        bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 1.5})  # fmt: skip
    clocks = "one clock" if data.delays.same_clock else "two clocks"
    histogram.set(xlabel=f"commands, of {len(totals)}", title=f"{clocks}; longest {summary.max_ms:.2f} ms")
    return figure


def with_gaps(times: Sequence[float], rows: Sequence[Sequence[float]]) -> tuple[list[float], list[list[float]]]:
    """Return times and rows of values, with a NaN in each gap, so that no line is drawn across it."""
    gaps = [index for index in range(1, len(times)) if times[index] - times[index - 1] > GAP_S]
    columns = [list(times), *map(list, rows)]
    for index in reversed(gaps):
        for column, value in zip(columns, (times[index - 1], *[nan] * len(rows)), strict=True):
            column.insert(index, value)
    return columns[0], columns[1:]


def _line(axes: Any, rows: Sequence[Row], column: int, **style: Any) -> None:
    """Draw one column over time; the line is interrupted at gaps between samples."""
    times, values = _column(rows, 0), _column(rows, column)
    if "drawstyle" not in style:
        times, (values,) = with_gaps(times, [values])
    axes.plot(times, values, **style)


def _column(rows: Sequence[Sequence[float]], column: int) -> list[float]:
    return [row[column] for row in rows]


def _finish(axes: Any, label: str) -> None:
    axes.set_ylabel(label)
    axes.set_xlim(left=0.0)
    add_legend(axes)
