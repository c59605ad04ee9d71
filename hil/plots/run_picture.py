"""Draw the picture of a run: the track on the map, depth and speed over time."""

import csv
import os
from collections.abc import Sequence
from math import degrees
from typing import Any

from hil.common.palette import (
    CLOSED,
    COMMANDED,
    EVENT,
    GOAL,
    HIDDEN_OBSTACLE,
    LAND,
    OBSTACLE,
    PATH,
    START,
    TRACK,
    WATER,
)
from hil.master.flight import Plan
from hil.plots.plotting import add_legend, fit_map, pyplot, save_figure
from hil.scenario.config import Scenario
from sim.environment.obstacles import Box, Cylinder
from sim.environment.world import World
from sim.run_events import RunEvent

MOST_CELLS = 2000  # of land along a side of a map; larger grids are thinned


def draw(folder: str, scenario: Scenario, plan: Plan, events: Sequence[RunEvent] = ()) -> str:
    """Draw a run's `track.csv` and events as `trajectory.png` beside it; return its path. Raises MissingExtraError."""
    plt = pyplot()
    with open(os.path.join(folder, "track.csv"), newline="", encoding="utf-8") as file:
        rows = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]
    figure, (field, depth, speed) = plt.subplots(3, 1, figsize=(10, 11), height_ratios=(6, 1, 1), layout="constrained")
    east, north = ([row[f"true_{axis}_m"] for row in rows] for axis in ("east", "north"))
    draw_flight(field, east, north, scenario, plan.world, plan, events)
    field.set(title=scenario.description)
    time = [row["time_s"] for row in rows]
    depth.plot(time, [row["true_depth_m"] for row in rows], color=TRACK, label="true")
    draw_depths(depth, scenario)
    depth.set(ylabel="depth (m)", xlim=(0, None))
    depth.invert_yaxis()
    add_legend(depth)
    speed.plot(time, [row["surge_m_s"] for row in rows], color=TRACK, label="true")
    speed.plot(time, [row["commanded_surge_m_s"] for row in rows], color=COMMANDED, linewidth=0.8, label="commanded")
    speed.set(xlabel="time (s)", ylabel="surge (m/s)", xlim=(0, None))
    add_legend(speed)
    return save_figure(figure, os.path.join(folder, "trajectory.png"))


def draw_flight(
    axes: Any, east: Sequence[float], north: Sequence[float], scenario: Scenario, world: World,
    plan: Plan | None = None, events: Sequence[RunEvent] = (),
) -> None:  # fmt: skip
    """Draw a track on the map of its world, with the mission and where the planner's map has no passage."""
    draw_world(axes, world)
    if plan:
        closed = plan.request.map.inflate(plan.request.clearance)
        _draw_cells(axes, closed.cells, closed.origin, closed.resolution, CLOSED, "closed to the planner", 0.5)
        draw_path(axes, plan.planner.path)
    axes.plot(east, north, color=TRACK, linewidth=2.0, label="track (true)")
    draw_start(axes, scenario)
    draw_goal(axes, scenario)
    draw_events(axes, events)
    places = scenario.master.places()
    fit_map(axes, [*east, *(place[1] for place in places)], [*north, *(place[0] for place in places)])


def _draw_cells(
    axes: Any, cells: Any, origin: Sequence[float], resolution: float, colour: str, label: str, zorder: float
) -> None:
    """Draw the cells that are True; `origin` is the south-west corner of the grid (m north, m east)."""
    import numpy as np
    from matplotlib.colors import ListedColormap

    south, west = origin
    extent = (west, west + cells.shape[1] * resolution, south, south + cells.shape[0] * resolution)
    axes.imshow(
        np.ma.masked_equal(cells, 0), origin="lower", extent=extent, cmap=ListedColormap([colour]),
        interpolation="nearest", zorder=zorder,
    )  # fmt: skip
    if np.any(cells):
        axes.plot([], [], "s", color=colour, markersize=9, markeredgecolor="0.6", label=label)


def draw_path(axes: Any, path: Sequence[Sequence[float]]) -> None:
    """Draw a planned path, if there is one."""
    if path:
        north, east, *_ = zip(*path, strict=True)
        axes.plot(east, north, color=PATH, linewidth=1, linestyle="--", label="planned path")


def draw_start(axes: Any, scenario: Scenario) -> None:
    """Draw the start of the vehicle."""
    axes.plot(scenario.start.east, scenario.start.north, "o", color=START, label="start", linestyle="none")


def draw_goal(axes: Any, scenario: Scenario) -> None:
    """Draw the mission's goal, if it has one, and its waypoints with their depths."""
    for north, east, depth in scenario.master.places()[:-1]:
        axes.plot(east, north, "D", color=GOAL, markersize=6, linestyle="none", label="waypoint and its depth")
        axes.annotate(f"  {depth:g} m", (east, north))
    if scenario.master.goal:
        north, east = scenario.master.goal
        axes.plot(east, north, "*", color=GOAL, markersize=14, linestyle="none", label="goal")


def draw_depths(axes: Any, scenario: Scenario) -> None:
    """Draw the depths of the mission's goal and its waypoints."""
    for depth in {scenario.master.depth, *(place[2] for place in scenario.master.places())}:
        axes.axhline(depth, color=COMMANDED, linewidth=0.8, linestyle="--", label="commanded")


def draw_world(axes: Any, world: World) -> None:
    """Draw land and obstacles from above, in their true size and position, and the walls if there are any.

    Upright ones that are not on the map have another colour.
    """
    import numpy as np
    from matplotlib.collections import PolyCollection
    from matplotlib.patches import Rectangle

    south, north, west, east = world.extent
    edge = "black" if world.walls else "0.75"
    axes.add_patch(Rectangle((west, south), east - west, north - south, facecolor=WATER, edgecolor=edge, zorder=0))
    if world.terrain:
        grid = world.terrain.grid
        step = -(-max(grid.rows, grid.columns) // MOST_CELLS)
        dry = ~(np.reshape(world.terrain.depths, (grid.rows, grid.columns))[::step, ::step] > 0.0)
        size = step * grid.resolution
        _draw_cells(axes, dry, (grid.north_min - 0.5 * size, grid.east_min - 0.5 * size), size, LAND, "land", 0.7)
    triangles = [triangle for mesh in world.mesh for triangle in np.reshape(mesh.placed, (-1, 3, 3))[..., 1::-1]]
    if triangles:
        axes.add_collection(PolyCollection(triangles, color=OBSTACLE, label="obstacle", zorder=1), autolim=False)
    for pipeline in world.pipeline:
        norths, easts = zip(*pipeline.points, strict=True)
        axes.plot(easts, norths, color=OBSTACLE, linewidth=1.6, label=pipeline.kind, zorder=1)
    for is_hidden, colour, label in ((False, OBSTACLE, "obstacle"), (True, HIDDEN_OBSTACLE, "obstacle not on the map")):
        cylinders = [each for each in world.cylinder if each.hidden is is_hidden]
        boxes = [each for each in world.box if each.hidden is is_hidden]
        for obstacle in outlines(cylinders, boxes):
            obstacle.set(color=colour, zorder=1, label=label)
            axes.add_patch(obstacle)


def outlines(cylinders: Sequence[Cylinder], boxes: Sequence[Box]) -> list[Any]:
    """Return the outlines of obstacles from above, as patches without a colour; east is to the right."""
    from matplotlib.patches import Circle, Rectangle

    patches: list[Any] = [Circle((pile.east, pile.north), pile.radius) for pile in cylinders]
    for box in boxes:
        corner = (box.east - 0.5 * box.size_east, box.north - 0.5 * box.size_north)
        turn = -degrees(box.heading)
        patches.append(Rectangle(corner, box.size_east, box.size_north, angle=turn, rotation_point="center"))
    return patches


def draw_events(axes: Any, events: Sequence[RunEvent]) -> None:
    """Draw a numbered cross where each event began, with its text in the legend."""
    for number, event in enumerate(events, 1):
        north, east, _ = event.position
        axes.plot(
            east, north, "X", color=EVENT, markersize=10, markeredgecolor="white", zorder=5,
            label=f"{number}: {event.name}, {event.start_ns * 1e-9:.1f} s",
        )  # fmt: skip
        axes.annotate(f" {number}", (east, north), color=EVENT, fontweight="bold", zorder=5)
