"""The picture of a run: the track on the map, depth and speed over time."""

import csv
import os
from typing import Any

from hil.bench.plotting import pyplot
from hil.config import Scenario
from hil.master.flight import Plan


def draw(folder: str, scenario: Scenario, plan: Plan) -> str:
    """Draw `track.csv` of a run's folder as `trajectory.png`; its path. Raises MissingExtraError."""
    plt = pyplot()
    with open(os.path.join(folder, "track.csv"), newline="") as file:
        rows = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]
    figure, (field, depth, speed) = plt.subplots(3, 1, figsize=(8, 11), height_ratios=(6, 1, 1), layout="constrained")
    _draw_map(field, scenario, plan, rows)
    time = [row["time_s"] for row in rows]
    depth.plot(time, [row["true_depth_m"] for row in rows], color="C0")
    depth.axhline(scenario.master.depth, color="0.6", linewidth=0.8, linestyle="--")
    depth.set(ylabel="depth (m)", xlim=(0, None))
    depth.invert_yaxis()
    speed.plot(time, [row["surge_m_s"] for row in rows], color="C0", label="true")
    speed.plot(time, [row["commanded_surge_m_s"] for row in rows], color="C1", linewidth=0.8, label="commanded")
    speed.set(xlabel="time (s)", ylabel="surge (m/s)", xlim=(0, None))
    speed.legend(loc="lower right", fontsize="small")
    path = os.path.join(folder, "trajectory.png")
    figure.savefig(path, dpi=110)
    plt.close(figure)
    return path


def _draw_map(axes: Any, scenario: Scenario, plan: Plan, rows: list[dict[str, float]]) -> None:
    grid = plan.brief.map
    rows_n, columns_n = grid.cells.shape
    south, west = grid.origin
    extent = (west, west + columns_n * grid.resolution, south, south + rows_n * grid.resolution)
    inflated = grid.inflate(plan.brief.clearance).cells
    shade = 1.0 - 0.12 * inflated - 0.55 * grid.cells
    axes.imshow(shade, origin="lower", extent=extent, cmap="gray", vmin=0, vmax=1, interpolation="nearest")
    if plan.planner.path:
        north, east = zip(*plan.planner.path, strict=True)
        axes.plot(east, north, color="C1", linewidth=1, linestyle="--", label="planned")
    axes.plot(
        [row["true_east_m"] for row in rows], [row["true_north_m"] for row in rows], color="C0", label="vehicle (true)"
    )
    axes.plot(scenario.start.east, scenario.start.north, "o", color="C2", label="start")
    if scenario.master.goal:
        axes.plot(scenario.master.goal[1], scenario.master.goal[0], "*", color="C3", markersize=14, label="goal")
    axes.set(xlabel="east (m)", ylabel="north (m)", aspect="equal", title=scenario.description)
    axes.legend(loc="lower right", fontsize="small")
