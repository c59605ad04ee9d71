"""Draw the figures of a case, and the spread over many seeds."""

from collections.abc import Callable, Sequence
from math import isfinite
from typing import Any

from hil.cases.record import Result, Run
from hil.common.palette import GOAL, HIDDEN_OBSTACLE, NAVIGATION, OBSTACLE, PATH, TRACK
from hil.plots.plotting import add_legend, pyplot, save_figure
from hil.plots.run_picture import draw_goal, draw_start
from hil.scenario.config import load_scenario
from hil.scenario.world_map import map_at
from sim.environment.world import World, load_world

COLOURS = {"sil": TRACK, "hil": NAVIGATION}
SPREAD: tuple[tuple[str, Callable[[Result], float]], ...] = (
    ("path over optimum", lambda r: r.ratio),
    ("least clearance (m)", lambda r: r.least_clearance),
    ("time (s)", lambda r: r.duration),
    ("energy (kJ)", lambda r: r.energy / 1e3),
)


def draw_field(title: str, runs: Sequence[Run], path: str) -> None:
    """Draw the map with planned and flown paths, and the speeds over time. Raises MissingExtraError."""
    plt = pyplot()
    figure, (field, speed) = plt.subplots(1, 2, figsize=(16, 6.5), width_ratios=(6, 5), layout="constrained")
    figure.suptitle(title)
    draw_world(field, runs[0].scenario)
    for number, run in enumerate(runs):
        for track in run.tracks:
            if number == 0 and track.plan:
                north, east, *_ = zip(*track.plan, strict=True)
                field.plot(east, north, "--", color=PATH, linewidth=1.2, label="path planned at the start")
            name = run.result.mode.upper()
            field.plot(
                track.east, track.north, color=COLOURS[run.result.mode], linewidth=1.4, label=f"track (true), {name}"
            )
    _mark(field, runs[0].scenario)
    field.set(title="from above, at the vehicle's depth")
    add_legend(field)
    draw_speeds(speed, runs)
    save_figure(figure, path)


def draw_world(axes: Any, scenario_path: str) -> None:
    """Draw the obstacles at the vehicle's depth: grey if on the map, brown if not."""
    scenario = load_scenario(scenario_path)
    world = load_world(scenario.world)
    mapped = world._replace(
        cylinder=tuple(o for o in world.cylinder if not o.hidden), box=tuple(o for o in world.box if not o.hidden)
    )
    hidden = world._replace(
        cylinder=tuple(o for o in world.cylinder if o.hidden), box=tuple(o for o in world.box if o.hidden), terrain=None
    )
    _fill(axes, mapped, scenario.master.depth, OBSTACLE, "obstacle")
    _fill(axes, hidden, scenario.master.depth, HIDDEN_OBSTACLE, "obstacle not on the map")
    south, north, west, east = world.extent
    axes.set(xlabel="east (m)", ylabel="north (m)", aspect="equal", xlim=(west, east), ylim=(south, north))


def _fill(axes: Any, world: World, depth: float, colour: str, label: str) -> None:
    grid = map_at(world, depth, 0.0, 0.1)
    if grid.cells.any():
        (south, west), (rows, columns) = grid.origin, grid.cells.shape
        extent = (west, west + columns * grid.resolution, south, south + rows * grid.resolution)
        axes.contourf(grid.cells, levels=(0.5, 1.5), colors=[colour], origin="lower", extent=extent)
        axes.plot([], [], "s", color=colour, label=label)


def _mark(axes: Any, scenario_path: str) -> None:
    scenario = load_scenario(scenario_path)
    draw_start(axes, scenario)
    draw_goal(axes, scenario)
    for task in scenario.planner.get("task", ()):
        north, east = task["at"]
        axes.plot(east, north, "s", color=GOAL)
        axes.annotate(task["name"], (east, north), xytext=(6, 6), textcoords="offset points", fontsize="small")


def draw_speeds(axes: Any, runs: Sequence[Run]) -> None:
    """Draw the commanded and the true surge velocity over time."""
    for run in runs:
        for number, track in enumerate(run.tracks):
            colour, name = COLOURS[run.result.mode], run.result.mode.upper()
            is_first = number == 0
            axes.plot(
                track.time,
                track.commanded_surge,
                color=colour,
                linewidth=0.7,
                alpha=0.45,
                label=f"{name}, commanded" if is_first else None,
            )
            axes.plot(track.time, track.surge, color=colour, linewidth=1.1, label=name if is_first else None)
    axes.set(xlabel="time (s)", ylabel="surge (m/s)", xlim=(0, None), title="surge velocity")
    add_legend(axes)


def draw_seeds(title: str, results: Sequence[Result], path: str) -> None:
    """Draw four results of every flight, as a dot each, with SIL and HIL in one panel. Raises MissingExtraError."""
    plt = pyplot()
    figure, panels = plt.subplots(1, len(SPREAD), figsize=(13, 3.2), layout="constrained")
    good = sum(result.success for result in results)
    figure.suptitle(f"{title}: {good} of {len(results)} flights succeed")
    for axes, (name, value) in zip(panels, SPREAD, strict=True):
        for mode, colour in COLOURS.items():
            dots = [(r.seed, value(r)) for r in results if r.mode == mode and isfinite(value(r))]
            if dots:
                seeds, values = zip(*dots, strict=True)
                axes.plot(seeds, values, "o" if mode == "sil" else "x", color=colour, markersize=4, label=mode.upper())
        failed = [(r.seed, value(r)) for r in results if not r.success and isfinite(value(r))]
        for seed, at in failed:
            axes.plot(seed, at, "o", color="k", fillstyle="none", markersize=9)
        axes.set(xlabel="seed", title=name)
        axes.title.set_fontsize("medium")
    add_legend(panels[-1])
    save_figure(figure, path)
