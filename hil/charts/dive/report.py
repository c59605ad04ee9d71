"""Write the report of a dive over a chart, with pictures, as HTML."""

import os
from collections.abc import Sequence
from html import escape
from math import isfinite
from typing import Any

import numpy as np

from hil.charts.describe import Facts
from hil.charts.dive.mosaic import stitch
from hil.charts.dive.watch import Observation
from hil.charts.grid import grid_of, write_file
from hil.charts.picture import add_depth_bar, draw_obstacles, hillshade
from hil.common.errors import MissionError
from hil.common.palette import LAND, PATH, TRACK
from hil.plots.plotting import add_legend, finish_map, pyplot, save_figure
from hil.plots.run_picture import draw_goal, draw_start
from hil.ros.diagnostics import Diagnostics, to_text
from hil.scenario.config import Scenario
from sim.environment.world import World, load_world
from sim.sensors.imaging.samples import SonarImageSample

FRAMES = 6  # camera pictures in the report
MARK, MEASURED = "#facc15", PATH
MAP_MARGIN = 25.0  # m of the map around the track
MOSAIC_RESOLUTION = 0.1  # m
RINGS = 6  # at most, in the picture of a sonar


def write_report(
    folder: str, scenario: Scenario, observations: Sequence[Observation], health: Diagnostics, bed: Facts = ()
) -> list[str]:
    """Draw the pictures and write report.html into `folder`, with facts on the `bed`; return the files.

    Raises MissionError if there are no observations, ConfigError, MissingExtraError.
    """
    if not observations:
        raise MissionError("the vehicle sent no pictures, so there is nothing to report; read slave.log")
    plt = pyplot()
    world = load_world(scenario.world)
    chosen = [
        observations[int(index)] for index in np.linspace(0, len(observations) - 1, min(FRAMES, len(observations)))
    ]
    figures = {
        "map": (
            _map(plt, world, scenario, observations, chosen),
            "The track over the seabed, lit from the north-west, and the camera's mosaic, with more contrast.",
        ),
        "altitude": (
            _altitude(plt, world, observations),
            "Seabed and vehicle from the side, and what the altimeter measured.",
        ),
        "camera": (_camera(plt, world, chosen), "Camera pictures, taken at the numbers on the map."),
        "sonar": (
            _sonar(plt, observations),
            "The forward-looking sonar's picture with the most contrast, seen from above; ahead is up.",
        ),
    }
    files = [save_figure(figure, os.path.join(folder, f"{name}.png")) for name, (figure, _) in figures.items()]
    rows = [*_figures(world, scenario, observations, health), *((f"bed: {name}", text) for name, text in bed)]
    captions = [(f"{name}.png", caption) for name, (_, caption) in figures.items()]
    files.append(os.path.join(folder, "report.html"))
    write_file(files[-1], _html(scenario.description, rows, captions).encode())
    return files


def _figures(
    world: World, scenario: Scenario, observations: Sequence[Observation], health: Diagnostics
) -> list[tuple[str, str]]:
    beds = [_bed(world, observation) - observation.truth.position[2] for observation in observations]
    rows = [
        ("chart", world.source),
        (
            "observed for",
            f"{observations[-1].time:.0f} s over {_travelled(observations):.0f} m at {scenario.master.depth:g} m",
        ),
        ("altitude", f"{min(beds):.1f} to {max(beds):.1f} m"),
    ]
    for name in ("camera", "forward_sonar"):
        requested, dropped = (
            (counts or {}).get(name, 0) for counts in (health.imaging_requested, health.imaging_dropped)
        )
        rows.append((name.replace("_", " "), f"{requested - dropped:.0f} of {requested:.0f} pictures in time"))
    return [*rows, ("loop late, 99 %", f"{to_text(health.lateness_p99_us, '.0f')} us")]


def _travelled(observations: Sequence[Observation]) -> float:
    places = np.array([observation.truth.position[:2] for observation in observations])
    return float(np.hypot(*np.diff(places, axis=0).T).sum())


def _bed(world: World, observation: Observation) -> float:
    return world.seabed(*observation.truth.position[:2])


def _map(
    plt: Any, world: World, scenario: Scenario, observations: Sequence[Observation], chosen: Sequence[Observation]
) -> Any:
    track = np.array([observation.truth.position[:2] for observation in observations])
    figure, axes = plt.subplots(figsize=(12, 8), layout="constrained")
    low, high = track.min(axis=0) - MAP_MARGIN, track.max(axis=0) + MAP_MARGIN
    image, lines = _draw_seabed(axes, world, low, high)
    mosaic = stitch(scenario, observations, grid_of(world), (low[0], high[0], low[1], high[1]), MOSAIC_RESOLUTION)
    axes.imshow(mosaic, origin="lower", extent=(low[1], high[1], low[0], high[0]), zorder=1.5)
    axes.set(xlim=(low[1], high[1]), ylim=(low[0], high[0]), title=scenario.description, facecolor=LAND)
    axes.clabel(lines, fontsize=7, fmt="%.3g m")
    if (seen := mosaic[..., 3] > 0).any():
        axes.plot([], [], "s", color=mosaic[seen].mean(axis=0) / 255.0, markersize=9, label="mosaic of the camera")
    axes.plot(track[:, 1], track[:, 0], color=TRACK, linewidth=2, label="track (true)")
    draw_start(axes, scenario)
    draw_goal(axes, scenario)
    for number, observation in enumerate(chosen, 1):
        _number(axes, observation.truth.position[1], observation.truth.position[0], number)
    axes.plot([], [], "o", color=MARK, markeredgecolor="black", markersize=9, label="place of a camera picture")
    axes.plot([], [], "s", color=LAND, label="land")
    axes.grid(visible=False)
    add_depth_bar(figure, axes, image)
    finish_map(axes)
    return figure


def _draw_seabed(axes: Any, world: World, low: Any, high: Any) -> tuple[Any, Any]:
    """Draw the seabed from `low` to `high` (m north, m east) with shading, contours and obstacles.

    Return image and contours.
    """
    grid = grid_of(world)
    south, north, west, east = grid.extent
    shown = grid.depths[_near(grid.north, low[0], high[0]), :][:, _near(grid.east, low[1], high[1])]
    image = axes.imshow(
        np.ma.masked_less_equal(grid.depths, 0.0), origin="lower", extent=(west, east, south, north), cmap="GnBu",
        vmin=0.0, vmax=float(np.nanmax(shown)),
    )  # fmt: skip
    axes.imshow(
        hillshade(grid.depths, grid.resolution), origin="lower", extent=(west, east, south, north), cmap="gray",
        alpha=0.35, interpolation="bilinear", vmin=0.0, vmax=1.0,
    )  # fmt: skip
    lines = axes.contour(grid.east, grid.north, grid.depths, 14, colors="#1f2937", linewidths=0.5, alpha=0.7)
    draw_obstacles(axes, world.cylinder, world.box)
    return image, lines


def _near(coordinates: Any, low: float, high: float) -> slice:
    first, last = np.searchsorted(coordinates, (low, high))
    return slice(max(0, int(first) - 1), int(last) + 1)


def _number(axes: Any, x: float, y: float, number: int) -> None:
    axes.annotate(
        str(number), (x, y), fontsize=8, ha="center", va="center",
        bbox={"boxstyle": "circle,pad=0.25", "facecolor": MARK, "edgecolor": "black", "linewidth": 0.6},
    )  # fmt: skip


def _altitude(plt: Any, world: World, observations: Sequence[Observation]) -> Any:
    times = [observation.time for observation in observations]
    depths = [observation.truth.position[2] for observation in observations]
    beds = [_bed(world, observation) for observation in observations]
    figure, axes = plt.subplots(figsize=(10, 4.5), layout="constrained")
    bottom = max(beds) + 1.5
    axes.fill_between(times, beds, bottom, color="#d6bf8f", label="seabed below the vehicle")
    axes.plot(times, beds, color="#5b4a25", linewidth=1.2)
    axes.plot(times, depths, color=TRACK, linewidth=2, label="vehicle")
    measured = [
        (observation.time, observation.truth.position[2] + observation.altitude)
        for observation in observations
        if isfinite(observation.altitude)
    ]
    if measured:
        axes.plot(*zip(*measured, strict=True), ".", color=MEASURED, markersize=5, label="altimeter")
    axes.set(xlabel="time (s)", ylabel="depth (m)", ylim=(bottom, 0.0), xlim=(times[0], times[-1] + 1e-9))
    add_legend(axes)
    return figure


def _camera(plt: Any, world: World, chosen: Sequence[Observation]) -> Any:
    figure, panels = plt.subplots(2, 3, figsize=(11, 6.2), layout="constrained")
    for axes in panels.flat:
        axes.axis("off")
    for number, (axes, observation) in enumerate(zip(panels.flat, chosen, strict=False), 1):
        picture = observation.camera
        axes.imshow(np.frombuffer(picture.data, np.uint8).reshape(picture.height, picture.width, 3))
        altitude = _bed(world, observation) - observation.truth.position[2]
        axes.set_title(f"{number}: {observation.time:.0f} s, {altitude:.1f} m above the bed", fontsize=10)
    return figure


def _sonar(plt: Any, observations: Sequence[Observation]) -> Any:
    """Draw the sonar picture with the strongest contrast as a fan, m to starboard and ahead, with range rings."""
    observation = max(observations, key=lambda observation: float(_echoes(observation.sonar).std()))
    sonar = observation.sonar
    figure, axes = plt.subplots(figsize=(10, 6.5), layout="constrained")
    angles = _edges(np.array(sonar.beams))
    ranges = sonar.first_range + sonar.range_step * np.arange(sonar.bins + 1)
    echoes = _echoes(sonar)
    image = axes.pcolormesh(
        ranges[:, None] * np.sin(angles), ranges[:, None] * np.cos(angles), echoes, cmap="inferno", rasterized=True,
        vmin=0.0, vmax=float(np.quantile(echoes, 0.999)) or 1.0,
    )  # fmt: skip
    for ring in plt.MaxNLocator(RINGS, steps=(1, 2, 5, 10)).tick_values(0.0, ranges[-1]):
        if 0.0 < ring <= ranges[-1]:
            axes.plot(ring * np.sin(angles), ring * np.cos(angles), color="white", linewidth=0.7, linestyle=":")
            axes.annotate(f"{ring:g} m", (0.0, ring), (0, -2), textcoords="offset points", color="white", fontsize=8,
                          ha="center", va="top")  # fmt: skip
    axes.plot(0.0, 0.0, "^", color=TRACK, markersize=11, markeredgecolor="white", label="vehicle")
    axes.set(
        aspect="equal", xlabel="to starboard (m)", ylabel="ahead (m)", facecolor="black",
        title=f"forward-looking sonar at {observation.time:.0f} s, {sonar.frequency / 1e3:.0f} kHz",
    )  # fmt: skip
    axes.grid(visible=False)
    figure.colorbar(image, ax=axes, label=f"strength of the echo ({sonar.encoding})", shrink=0.75, pad=0.01)
    return figure


def _echoes(sonar: SonarImageSample) -> Any:
    """Return the echoes: one row per range, one column per beam."""
    kind = np.uint8 if sonar.encoding == "uint8" else np.float32
    return np.frombuffer(sonar.intensities, kind).reshape(sonar.bins, len(sonar.beams))


def _edges(middles: Any) -> Any:
    half = 0.5 * np.diff(middles)
    return np.concatenate([[middles[0] - half[0]], middles[:-1] + half, [middles[-1] + half[-1]]])


def _html(title: str, rows: Sequence[tuple[str, str]], pictures: Sequence[tuple[str, str]]) -> str:
    table = "".join(f"<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>" for name, value in rows)
    figures = "".join(
        f'<figure><img src="{file}" alt="{escape(caption)}"><figcaption>{escape(caption)}</figcaption></figure>'
        for file, caption in pictures
    )
    style = "body{font-family:sans-serif;max-width:70em;margin:2em auto}img{max-width:100%}th{text-align:left}"
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        f"<style>{style}</style></head><body><h1>{escape(title)}</h1><table>{table}</table>{figures}"
        "<p>Not for navigation.</p></body></html>\n"
    )
