"""Draw the figure of a case of one vehicle."""

from collections.abc import Sequence
from typing import Any

from hil.cases.record import Run
from hil.common.palette import GOAL, NAVIGATION, PATH, TRACK
from hil.plots.plotting import add_legend, finish_map, pyplot, save_figure
from hil.plots.run_picture import draw_goal, draw_start, draw_world
from hil.scenario.config import Scenario, load_scenario
from sim.environment.world import load_world

COLOURS = {"sil": TRACK, "hil": NAVIGATION}


def draw_field(title: str, runs: Sequence[Run], path: str) -> None:
    """Draw the map with planned and flown paths, and the speeds over time. Raises MissingExtraError."""
    plt = pyplot()
    figure, (field, speed) = plt.subplots(1, 2, figsize=(16, 6.5), width_ratios=(6, 5), layout="constrained")
    figure.suptitle(title)
    scenario = load_scenario(runs[0].scenario)
    world = load_world(scenario.world)
    draw_world(field, world)
    for number, run in enumerate(runs):
        for track in run.tracks:
            if number == 0 and track.plan:
                north, east, *_ = zip(*track.plan, strict=True)
                field.plot(east, north, "--", color=PATH, linewidth=1.2, label="path planned at the start")
            name = run.result.mode.upper()
            field.plot(
                track.east, track.north, color=COLOURS[run.result.mode], linewidth=1.4, label=f"track (true), {name}"
            )
    _mark(field, scenario)
    field.set(xlim=world.extent[2:], ylim=world.extent[:2], title="from above, at the vehicle's depth")
    finish_map(field)
    draw_speeds(speed, runs)
    save_figure(figure, path)


def _mark(axes: Any, scenario: Scenario) -> None:
    draw_start(axes, scenario)
    draw_goal(axes, scenario)
    for task in scenario.planner.get("task", ()):
        north, east = task["at"]
        axes.plot(east, north, "s", color=GOAL)
        axes.annotate(task["name"], (east, north), xytext=(6, 6), textcoords="offset points", fontsize="small")


def draw_speeds(axes: Any, runs: Sequence[Run]) -> None:
    """Draw the commanded and the true surge velocity over time."""
    for run in runs:
        for track in run.tracks:
            colour, name = COLOURS[run.result.mode], run.result.mode.upper()
            axes.plot(
                track.time, track.commanded_surge, color=colour, linewidth=0.7, alpha=0.45, label=f"{name}, commanded"
            )
            axes.plot(track.time, track.surge, color=colour, label=name)
    axes.set(xlabel="time (s)", ylabel="surge (m/s)", xlim=(0, None), title="surge velocity")
    add_legend(axes)
