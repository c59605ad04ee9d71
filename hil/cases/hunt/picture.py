"""Draw the figures of a hunt: paths with the formation, and distances and errors over time.

The paths are drawn as in the paper, with its x (north here) to the right and its y (east here) upwards.
"""

from collections.abc import Sequence
from itertools import combinations
from math import atan2, dist, hypot
from typing import Any

from hil.autonomy.fleets.formation import formation_error
from hil.autonomy.fleets.hunting import HuntPlan
from hil.cases.record import Run, Track
from hil.common.palette import EVENT, GOAL
from hil.plots.plotting import add_legend, curve, pyplot, save_figure
from hil.scenario.config import load_scenario
from hil.scenario.fleet import hunt_plan, hunting_of

SNAPSHOTS = 4  # of the formation, from the start to the end
LINES = {"sil": "-", "hil": "--"}


def draw_hunt(title: str, runs: Sequence[Run], path: str) -> None:
    """Draw the paths of each run, and distances and errors of all runs over time.

    Raises MissingExtraError.
    """
    plt = pyplot()
    figure = plt.figure(figsize=(7.0 * len(runs) + 6.8, 6.8), layout="constrained")
    grid = figure.add_gridspec(3, len(runs) + 1, width_ratios=[7.0] * len(runs) + [5.2])
    figure.suptitle(title)
    scenario = load_scenario(runs[0].scenario)
    plan = hunt_plan(scenario)
    for column, run in enumerate(runs):
        axes = figure.add_subplot(grid[:, column])
        _draw_paths(axes, run, plan)
        axes.set(title=f"{run.result.mode.upper()}, seed {run.result.seed}")
    panels = [figure.add_subplot(grid[row, len(runs)]) for row in range(3)]
    for run in runs:
        _draw_times(panels, run, plan)
    panels[0].axhline(hunting_of(scenario).min_separation, color=EVENT, linewidth=0.8, label="least allowed")
    panels[1].axvline(plan.approach, color="0.6", linewidth=0.8, linestyle=":", label="end of the approach")
    panels[2].axhline(plan.ring, color=GOAL, linewidth=0.8, linestyle="--", label="ring")
    panels[0].set(
        ylabel="distance (m)", title="between the two nearest vehicles", ylim=(0, 1.4 * panels[0].get_ylim()[1])
    )
    panels[1].set(ylabel="distance (m)", title="greatest error of the formation", ylim=(0, None))
    panels[2].set(ylabel="distance (m)", title="of each vehicle from the target", ylim=(0, None), xlabel="time (s)")
    for panel in panels:
        add_legend(panel)
    save_figure(figure, path)


def _draw_paths(axes: Any, run: Run, plan: HuntPlan) -> None:
    """Draw the paths, the formation at SNAPSHOTS times, the target and the ring."""
    axes.plot(*plan.target, "*", color=GOAL, markersize=14, label="target", linestyle="none")
    axes.add_patch(pyplot().Circle(plan.target, plan.ring, fill=False, color=GOAL, linestyle="--", label="ring"))
    for number, track in enumerate(run.tracks):
        axes.plot(track.north, track.east, **curve(number), label=track.name)
        axes.plot(track.north[0], track.east[0], "o", color=curve(number)["color"], fillstyle="none")
    time = run.tracks[0].time
    for shot in range(SNAPSHOTS):
        at = round(shot * (len(time) - 1) / (SNAPSHOTS - 1))
        _draw_snapshot(axes, run.tracks, plan, at, shot / (SNAPSHOTS - 1))
    axes.set(xlabel="north, the paper's x (m)", ylabel="east, the paper's y (m)", aspect="equal")
    axes.set(xlim=(-1, 11), ylim=(-1, 11))
    add_legend(axes)


def _draw_snapshot(axes: Any, tracks: Sequence[Track], plan: HuntPlan, at: int, age: float) -> None:
    """Draw the positions at one time, joined in their order on the ring; `age`, 0 to 1, makes them darker."""
    shade = str(0.75 - 0.6 * age)
    positions = [(track.north[at], track.east[at]) for track in tracks]
    order = _order_on_ring(plan)
    outline = [positions[number] for number in (*order, order[0])]
    axes.plot(*zip(*outline, strict=True), color=shade, linewidth=0.8, linestyle=":")
    axes.plot(*zip(*positions, strict=True), "s", color=shade, markersize=6, zorder=3)
    axes.annotate(f"{tracks[0].time[at]:.0f} s", max(positions), xytext=(7, 3), textcoords="offset points", fontsize=8)


def _order_on_ring(plan: HuntPlan) -> list[int]:
    """Return the numbers of the vehicles in their order on the ring."""
    ends = [plan.position_at(number, plan.duration) for number in range(len(plan.starts))]
    bearing = [atan2(end[1] - plan.target[1], end[0] - plan.target[0]) for end in ends]
    return sorted(range(len(ends)), key=lambda number: bearing[number])


def _draw_times(panels: Sequence[Any], run: Run, plan: HuntPlan) -> None:
    """Draw over time the least distance between vehicles, the formation error and the distances from the target."""
    mode = run.result.mode
    style = {"linestyle": LINES[mode], "linewidth": 1.1}
    time = run.tracks[0].time
    instants = list(zip(*(track.points for track in run.tracks), strict=True))
    nearest = [min(dist(a, b) for a, b in combinations(places, 2)) for places in instants]
    panels[0].plot(time, nearest, color="C0", label=f"{mode.upper()}, nearest pair", **style)
    panels[1].plot(time, [formation_error(places, plan.starts) for places in instants], color="C0", **style)
    for number, track in enumerate(run.tracks):
        away = [hypot(n - plan.target[0], e - plan.target[1]) for n, e in track.points]
        panels[2].plot(time, away, color=curve(number)["color"], **style)
