"""Draw a seabed: shaded from the north-west, coloured by depth, with the chart's features."""

import os
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.charts.grid import Depths, Grid, thinning_step
from hil.common.palette import LAND, OBSTACLE
from hil.plots.plotting import finish_map, pyplot, save_figure
from hil.plots.run_picture import outlines
from sim.environment.obstacles import Box, Cylinder
from sim.environment.things.pipelines import Pipeline
from sim.environment.things.zones import Zone

Array = NDArray[np.float64]

UNKNOWN, SHORE, INK = "#e8e8e8", "#5b4a25", "#1f2937"
CHARTED = "#be18a0"
DASHES = {
    "restricted": (6, 2), "military": (6, 2, 1, 2), "anchorage": (3, 3), "dumping": (1, 2), "cable": (8, 2, 1, 2, 1, 2),
    "pipeline": (8, 2, 2, 2), "farm": (2, 2, 1, 2),
}  # fmt: skip
SUN_AZIMUTH, SUN_ALTITUDE = np.radians(315.0), np.radians(45.0)
MEAN_SHADE_SLOPE = 0.35  # heights are scaled until the steeper slopes have about this slope, to show the relief
MAX_NUMBERS = 350  # soundings shown as numbers; more are shown as dots
MAX_DOTS = 10_000  # soundings shown as dots; more would hide the bed and are not drawn
MAX_PIXELS = 1320  # along a side, as many as the figure has
MAX_TRACED = 330  # nodes along a side of the grid for contours of worlds that have no charted ones
STRIP_ROWS = 64  # rows of pixels coloured at once


class MapMarks(NamedTuple):
    """Overlay of the map; all positions are north, east in m.

    Soundings (n, 3), charted contours with their depths, shore lines, bridges, pipelines, zones, and outlines of meshes
    (each (n, 2)).
    """

    soundings: Array = np.empty((0, 3))
    contours: tuple[tuple[Array, float], ...] = ()
    shore: tuple[Array, ...] = ()
    bridges: tuple[Array, ...] = ()
    pipelines: tuple[Pipeline, ...] = ()
    zones: tuple[Zone, ...] = ()
    meshes: tuple[Array, ...] = ()


def draw(
    grid: Grid, cylinders: tuple[Cylinder, ...], boxes: tuple[Box, ...], marks: MapMarks, title: str, path: str
) -> None:
    """Draw a map of the seabed and its obstacles into the image file `path`. Raises ConfigError, MissingExtraError."""
    plt = pyplot()
    grid = _thin(grid, MAX_PIXELS)
    south, north, west, east = grid.extent
    figure, axes = plt.subplots(figsize=_size(east - west, north - south), layout="constrained")
    colours, scale = _shaded(grid, plt)
    _draw_pixels(axes, grid, colours)
    _draw_marks(axes, grid, marks)
    draw_obstacles(axes, cylinders, boxes)
    add_depth_bar(figure, axes, scale)
    axes.set(xlim=(west, east), ylim=(south, north), title=title)
    axes.grid(visible=False)
    finish_map(axes)
    # A PNG is so written in a fourth of the time, at the cost of a slightly larger file.
    options = {"pil_kwargs": {"compress_level": 2}} if path.lower().endswith(".png") else {}
    save_figure(figure, os.path.abspath(path), 120, **options)


def add_depth_bar(figure: Any, axes: Any, scale: Any) -> None:
    """Add the colour bar of depths to the left of a map; its legend is to the right."""
    figure.colorbar(scale, ax=axes, label="depth (m)", shrink=0.8, pad=0.02, location="left").ax.invert_yaxis()


def _draw_pixels(axes: Any, grid: Grid, colours: NDArray[np.uint8]) -> None:
    """Draw one pixel of the bed around each node. (imshow would take ten times the memory of the picture.)"""
    from matplotlib.image import PcolorImage

    south, _, west, _ = grid.extent
    rows, columns = (np.arange(count + 1) - 0.5 for count in grid.depths.shape)
    picture = PcolorImage(axes, west + grid.resolution * columns, south + grid.resolution * rows, colours, zorder=0)
    picture.set_in_layout(False)
    axes.add_image(picture)


def _size(wide: float, high: float) -> tuple[float, float]:
    """Return the size of the figure in inches: 11 for the longer side of the map, plus room for scales and legend."""
    inch = 11.0 / max(wide, high)
    return max(6.0, wide * inch + 4.2), max(4.0, high * inch + 1.2)


def _thin(grid: Grid, most: int) -> Grid:
    step = thinning_step(grid, most)
    return grid._replace(depths=grid.depths[::step, ::step], resolution=grid.resolution * step)


def hillshade(depths: Depths, resolution: float) -> Depths:
    """Return the brightness of each node, 0 to 1, by Lambert's law; heights are scaled to show the relief."""
    strips = _strips(len(depths))
    thin = (np.array([slope[::3, ::3].ravel() for slope in _slopes(depths, resolution, part)]) for part in strips)
    sample = [np.sqrt((slopes * slopes).sum(axis=0)) for slopes in thin]
    steep = float(np.quantile(np.concatenate(sample), 0.9))
    stretch = np.float32(min(MEAN_SHADE_SLOPE / steep, 20.0) if steep > 0.0 else 1.0)
    light = np.float32(np.cos(SUN_AZIMUTH)), np.float32(np.sin(SUN_AZIMUTH))
    bright = np.empty(depths.shape, np.float32)
    for part in strips:
        to_north, to_east = (stretch * slope for slope in _slopes(depths, resolution, part))
        facing = np.sin(SUN_ALTITUDE) - np.cos(SUN_ALTITUDE) * (light[0] * to_north + light[1] * to_east)
        bright[part] = np.clip(facing / np.sqrt(1.0 + to_north**2 + to_east**2), 0.0, 1.0)
    return bright


def _strips(rows: int) -> list[slice]:
    return [slice(start, min(start + STRIP_ROWS, rows)) for start in range(0, rows, STRIP_ROWS)]


def _slopes(depths: Depths, resolution: float, rows: slice) -> list[Depths]:
    """Return the slope of the bed to the north and to the east in `rows`; 0 where it is unknown."""
    first, last = max(0, min(rows.start - 1, len(depths) - 2)), rows.stop + 1
    slopes: Any = np.gradient(-depths[first:last], resolution)
    return [np.nan_to_num(slope[rows.start - first : rows.stop - first]) for slope in slopes]


def _shaded(grid: Grid, plt: Any) -> tuple[NDArray[np.uint8], Any]:
    """Return the RGB colour of every node, and the scale of depths for the colour bar."""
    from matplotlib import cm, colors

    scale = cm.ScalarMappable(colors.PowerNorm(0.6, *_range(grid.depths)), plt.get_cmap("GnBu"))
    shade = 0.45 + 0.78 * hillshade(grid.depths, grid.resolution)
    pixels = np.empty((*grid.depths.shape, 3), np.uint8)
    for part in _strips(len(pixels)):
        depths = grid.depths[part]
        colours = scale.to_rgba(np.where(np.isfinite(depths), depths, 0.0))[..., :3]
        colours[depths <= 0.0] = colors.to_rgb(LAND)
        colours *= shade[part][..., None]
        colours[~np.isfinite(depths)] = colors.to_rgb(UNKNOWN)
        pixels[part] = np.clip(255.0 * colours + 0.5, 0.0, 255.0)
    return pixels, scale


def _range(depths: Depths) -> tuple[float, float]:
    """Return the least and greatest depth of the colour scale; it begins at 0 unless all of the bed is deep."""
    water = depths[depths > 0.0]
    if not len(water):
        return 0.0, 1.0
    low, high = float(water.min()), float(water.max())
    if high - low < 0.01 * high:
        return 0.0, 2.0 * high  # a flat bed
    return (low if low > 0.3 * high else 0.0), high


def _draw_marks(axes: Any, grid: Grid, marks: MapMarks) -> None:
    from matplotlib.collections import LineCollection

    if marks.contours:
        axes.add_collection(LineCollection(
            [line[:, ::-1] for line, _ in marks.contours], colors=INK, linewidths=0.45, alpha=0.6, zorder=2
        ))  # fmt: skip
    elif np.nanmax(grid.depths) > np.nanmin(grid.depths):
        coarse = _thin(grid, MAX_TRACED)
        lines = axes.contour(
            coarse.east, coarse.north, coarse.depths, 8, colors=INK, linewidths=0.45, alpha=0.6, zorder=2
        )
        for label in axes.clabel(lines, fontsize=7, fmt="%g"):
            label.set_in_layout(False)  # labels are inside the map and need no room in the layout
    for lines, colour, width, label in ((marks.shore, SHORE, 0.9, "shore"), (marks.bridges, "black", 2.0, "bridge")):
        drawn = LineCollection([line[:, ::-1] for line in lines], colors=colour, linewidths=width, zorder=3)
        drawn.set_label(label if lines else "")
        axes.add_collection(drawn)
    _draw_soundings(axes, marks.soundings)
    _draw_charted(axes, marks)


def _draw_charted(axes: Any, marks: MapMarks) -> None:
    """Draw zones, pipelines and cables in magenta, as charts do."""
    from matplotlib.collections import PolyCollection

    label = "obstacle" if marks.meshes else ""
    axes.add_collection(PolyCollection([m[:, ::-1] for m in marks.meshes], facecolors=OBSTACLE, zorder=5, label=label))
    for zone in marks.zones:
        line, dashes = np.array([*zone.outline, zone.outline[0]]), DASHES[zone.kind]
        axes.plot(
            line[:, 1], line[:, 0], color=CHARTED, linewidth=1.0, dashes=dashes, label=f"{zone.kind} area", zorder=4
        )
    for pipeline in marks.pipelines:
        line, style = np.array(pipeline.points), "-" if pipeline.kind == "pipeline" else ":"
        axes.plot(line[:, 1], line[:, 0], style, color=CHARTED, linewidth=1.6, label=pipeline.kind, zorder=4)


def _draw_soundings(axes: Any, soundings: Array) -> None:
    if len(soundings) > MAX_DOTS:
        return
    if len(soundings) > MAX_NUMBERS:
        axes.plot(
            soundings[:, 1], soundings[:, 0], ".", color=INK, markersize=1.6, alpha=0.8, label="sounding", zorder=4
        )
        return
    for north, east, depth in soundings:
        text = f"{depth:.1f}" if depth < 31.0 else f"{depth:.0f}"
        axes.annotate(text, (east, north), fontsize=5.5, color=INK, ha="center", va="center", clip_on=True, zorder=4)


def draw_obstacles(axes: Any, cylinders: tuple[Cylinder, ...], boxes: tuple[Box, ...]) -> None:
    """Draw obstacles in true size; cylinders also have a cross, which is visible at any scale."""
    from matplotlib.collections import PatchCollection

    drawn = PatchCollection(outlines(cylinders, boxes), facecolor=OBSTACLE, edgecolor="white", linewidth=0.4, zorder=5)
    drawn.set_in_layout(False)
    axes.add_collection(drawn)
    axes.plot(
        [pile.east for pile in cylinders], [pile.north for pile in cylinders],
        "+", color=OBSTACLE, markersize=5, markeredgewidth=0.9, zorder=5,
    )  # fmt: skip
    if cylinders or boxes:
        axes.plot([], [], "s", color=OBSTACLE, label="obstacle")
