"""Draw a seabed: shaded from the north-west, coloured by depth, with the chart's features."""

import os
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.charts.grid import Depths, Grid
from hil.common.errors import ConfigError
from hil.plots.plotting import pyplot
from sim.environment.obstacles import Box, Cylinder

Array = NDArray[np.float64]

LAND, UNKNOWN, SHORE, INK, OBSTACLE = "#d9c69a", "#e8e8e8", "#5b4a25", "#1f2937", "#c2410c"
SUN_AZIMUTH, SUN_ALTITUDE = np.radians(315.0), np.radians(45.0)
MEAN_SHADE_SLOPE = 0.35  # heights are stretched until the steeper slopes are about this steep: then relief is seen
MOST_NUMBERS = 350  # soundings beyond that are dots,
MOST_DOTS = 10_000  # and beyond that they would hide the bed
MOST_PIXELS = 1320  # along a side: as many as the figure has


class Marks(NamedTuple):
    """Overlay of the map: soundings (n, 3), charted contours, shore lines and bridges, all north, east in m."""

    soundings: Array = np.empty((0, 3))
    contours: tuple[tuple[Array, float], ...] = ()
    shore: tuple[Array, ...] = ()
    bridges: tuple[Array, ...] = ()


def draw(
    grid: Grid, cylinders: tuple[Cylinder, ...], boxes: tuple[Box, ...], marks: Marks, title: str, path: str
) -> None:
    """Draw it into the image file `path`. Raises ConfigError, MissingExtraError."""
    plt = pyplot()
    grid = _thinned(grid)
    south, north, west, east = grid.extent
    figure, axes = plt.subplots(figsize=_size(east - west, north - south), layout="constrained")
    try:
        colours, scale = _shaded(grid, plt)
        half = 0.5 * grid.resolution
        axes.imshow(
            colours, origin="lower", extent=(west - half, east + half, south - half, north + half),
            interpolation="nearest", zorder=0,
        )  # fmt: skip
        _draw_marks(axes, grid, marks)
        _draw_obstacles(axes, cylinders, boxes)
        _draw_scale_bar(axes, grid)
        bar = figure.colorbar(scale, ax=axes, label="depth (m)", shrink=0.8, pad=0.01)
        bar.ax.invert_yaxis()
        axes.set(
            xlim=(west, east), ylim=(south, north), xlabel="east (m)", ylabel="north (m)", title=title, aspect="equal"
        )
        figure.savefig(path, dpi=120)
    except (OSError, ValueError) as error:
        text = error.strerror if isinstance(error, OSError) else str(error).splitlines()[0]
        raise ConfigError(f"{os.path.abspath(path)}: cannot be drawn: {text}") from None
    finally:
        plt.close(figure)


def _size(wide: float, high: float) -> tuple[float, float]:
    """Return the size of the figure in inches: the map's longer side is 11, plus room for its scales."""
    inch = 11.0 / max(wide, high)
    return max(5.0, wide * inch + 2.2), max(4.0, high * inch + 1.2)


def _thinned(grid: Grid) -> Grid:
    step = 1 + max(grid.depths.shape) // MOST_PIXELS
    return grid._replace(depths=grid.depths[::step, ::step], resolution=grid.resolution * step)


def hillshade(depths: Depths, resolution: float) -> Array:
    """Return how bright each node is, 0 to 1: Lambert's law, heights stretched so that the relief shows."""
    to_north, to_east = np.gradient(-depths.astype(float), resolution)
    to_north, to_east = np.nan_to_num(to_north), np.nan_to_num(to_east)
    steep = float(np.quantile(np.hypot(to_north, to_east), 0.9))
    stretch = min(MEAN_SHADE_SLOPE / steep, 20.0) if steep > 0.0 else 1.0
    to_north, to_east = stretch * to_north, stretch * to_east
    light = np.cos(SUN_AZIMUTH), np.sin(SUN_AZIMUTH)
    facing = np.sin(SUN_ALTITUDE) - np.cos(SUN_ALTITUDE) * (light[0] * to_north + light[1] * to_east)
    return np.asarray(np.clip(facing / np.sqrt(1.0 + to_north**2 + to_east**2), 0.0, 1.0))


def _shaded(grid: Grid, plt: Any) -> tuple[Array, Any]:
    """RGBA of every node, and the scale of depths for the colour bar."""
    from matplotlib import cm, colors

    depths = grid.depths
    norm = colors.PowerNorm(0.6, *_range(depths))
    scale = cm.ScalarMappable(norm, plt.get_cmap("GnBu"))
    colours = scale.to_rgba(np.where(np.isfinite(depths), depths, 0.0))
    colours[depths <= 0.0] = colors.to_rgba(LAND)
    shade = hillshade(depths, grid.resolution)
    colours[..., :3] *= (0.45 + 0.78 * shade)[..., None]
    colours[~np.isfinite(depths)] = colors.to_rgba(UNKNOWN)
    return np.clip(colours, 0.0, 1.0), scale


def _range(depths: Depths) -> tuple[float, float]:
    """Return the depths that the colours go from and to: from the surface, unless all is far below it."""
    water = depths[depths > 0.0]
    if not len(water):
        return 0.0, 1.0
    low, high = float(water.min()), float(water.max())
    if high - low < 0.01 * high:
        return 0.0, 2.0 * high  # a flat bed
    return (low if low > 0.3 * high else 0.0), high


def _draw_marks(axes: Any, grid: Grid, marks: Marks) -> None:
    from matplotlib.collections import LineCollection

    if marks.contours:
        axes.add_collection(LineCollection(
            [line[:, ::-1] for line, _ in marks.contours], colors=INK, linewidths=0.45, alpha=0.6, zorder=2
        ))  # fmt: skip
    elif np.nanmax(grid.depths) > np.nanmin(grid.depths):
        lines = axes.contour(grid.east, grid.north, grid.depths, 8, colors=INK, linewidths=0.45, alpha=0.6, zorder=2)
        axes.clabel(lines, fontsize=7, fmt="%g")
    for lines, colour, width in ((marks.shore, SHORE, 0.9), (marks.bridges, "black", 2.0)):
        axes.add_collection(
            LineCollection([line[:, ::-1] for line in lines], colors=colour, linewidths=width, zorder=3)
        )
    _draw_soundings(axes, marks.soundings)


def _draw_soundings(axes: Any, soundings: Array) -> None:
    if len(soundings) > MOST_DOTS:
        return
    if len(soundings) > MOST_NUMBERS:
        axes.plot(soundings[:, 1], soundings[:, 0], ".", color=INK, markersize=1.6, alpha=0.8, zorder=4)
        return
    for north, east, depth in soundings:
        text = f"{depth:.1f}" if depth < 31.0 else f"{depth:.0f}"
        axes.annotate(text, (east, north), fontsize=5.5, color=INK, ha="center", va="center", clip_on=True, zorder=4)


def _draw_obstacles(axes: Any, cylinders: tuple[Cylinder, ...], boxes: tuple[Box, ...]) -> None:
    """Draw obstacles in true size, each with a cross that stays visible."""
    from matplotlib.patches import Circle, Rectangle

    for pile in cylinders:
        axes.add_patch(Circle((pile.east, pile.north), pile.radius, facecolor=OBSTACLE, alpha=0.9, zorder=5))
    for box in boxes:
        corner = box.east - 0.5 * box.size_east, box.north - 0.5 * box.size_north
        axes.add_patch(Rectangle(
            corner, box.size_east, box.size_north, angle=-np.degrees(box.heading), rotation_point="center",
            facecolor=OBSTACLE, alpha=0.9, zorder=5,
        ))  # fmt: skip
    if cylinders:
        axes.plot(
            [pile.east for pile in cylinders], [pile.north for pile in cylinders],
            "+", color=OBSTACLE, markersize=5, markeredgewidth=0.9, zorder=5,
        )  # fmt: skip


def _draw_scale_bar(axes: Any, grid: Grid) -> None:
    """A bar of a round length, about a fifth of the width, and an arrow to the north."""
    south, north, west, east = grid.extent
    wanted = 0.2 * (east - west)
    decade = 10.0 ** np.floor(np.log10(wanted))
    length = max(step * decade for step in (1.0, 2.0, 5.0) if step * decade <= wanted)
    x, y = west + 0.04 * (east - west), south + 0.04 * (north - south)
    white = {"facecolor": "white", "alpha": 0.75, "edgecolor": "none", "pad": 2.0}
    axes.plot([x, x + length], [y, y], color="black", linewidth=4, solid_capstyle="butt", zorder=6)
    axes.plot([x, x + 0.5 * length], [y, y], color="white", linewidth=2, solid_capstyle="butt", zorder=7)
    text = f"{length / 1000:g} km" if length >= 1000.0 else f"{length:g} m"
    axes.annotate(text, (x + 0.5 * length, y), (0, 6), textcoords="offset points", ha="center", bbox=white, zorder=6)
    axes.annotate(
        "N", (0.965, 0.985), (0.965, 0.93), xycoords="axes fraction", ha="center", va="center", bbox=white, zorder=6,
        arrowprops={"arrowstyle": "-|>", "color": "black"},
    )  # fmt: skip
