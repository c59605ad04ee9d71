"""Style and common functions of all figures: import matplotlib on first use, fit maps, save files, add legends."""

import os
from collections.abc import Sequence
from math import floor, log10
from typing import Any

from hil.common.errors import ConfigError, MissingExtraError
from hil.common.palette import GRID, SERIES

DPI = 110
BELOW_NUMBERS_IN = -0.28  # of a map's lower axis
DASHES = ("-", "--")  # in turn, so that neighbours differ in grey print too
STYLE: Any = {
    "font.size": 10.0, "axes.titlesize": 11.0, "axes.titleweight": "bold", "axes.titlelocation": "left",
    "figure.titlesize": 13.0, "figure.titleweight": "bold", "legend.fontsize": 9.0, "legend.frameon": False,
    "axes.grid": True, "axes.axisbelow": True, "grid.color": GRID, "grid.linewidth": 0.6, "axes.edgecolor": "0.45",
    "xtick.color": "0.25", "ytick.color": "0.25", "lines.linewidth": 1.3,
    "axes.prop_cycle": f"cycler(color={list(SERIES)})",
}  # fmt: skip


def pyplot() -> Any:
    """Return matplotlib.pyplot in our style, with a backend that needs no screen. Raises MissingExtraError."""
    try:
        import matplotlib as mpl
    except ImportError:
        raise MissingExtraError("the picture needs matplotlib: pip install 'uuv-hil[master]'") from None
    mpl.use("Agg")
    import matplotlib.pyplot as plt

    mpl.rcParams.update(STYLE)
    return plt


def curve(number: int) -> dict[str, Any]:
    """Return colour and dashes of the curve of this number, from 0; 14 curves differ."""
    return {"color": SERIES[number % len(SERIES)], "linestyle": DASHES[number % len(DASHES)]}


def check_picture(path: str) -> None:
    """Check that a picture of this file type can be drawn. Raises MissingExtraError, ConfigError."""
    kinds = sorted(pyplot().FigureCanvasBase.get_supported_filetypes())
    if os.path.splitext(path)[1].removeprefix(".") not in kinds:
        raise ConfigError(f"{path}: unknown picture format: use .{', .'.join(kinds)}")


def save_figure(figure: Any, path: str, dpi: int = DPI, **options: Any) -> str:
    """Write the figure to `path`, close it, and return the path; `options` of its format. Raises ConfigError."""
    try:
        figure.savefig(path, dpi=dpi, **options)
    except (OSError, ValueError) as error:
        text = error.strerror if isinstance(error, OSError) else str(error).splitlines()[0]
        raise ConfigError(f"{path}: cannot be written: {text}") from None
    finally:
        pyplot().close(figure)
    return path


def add_legend(axes: Any, **options: Any) -> None:
    """Add a legend to the right of the axes, where it covers no curve; one entry for equal labels, none: no legend."""
    handles, labels = axes.get_legend_handles_labels()
    if named := dict(zip(labels, handles, strict=True)):
        options = {"loc": "upper left", "bbox_to_anchor": (1.01, 1.0), "borderaxespad": 0.0, **options}
        axes.legend(named.values(), named.keys(), **options)


def fit_map(axes: Any, east: Sequence[float], north: Sequence[float]) -> None:
    """Limit a map to the points (m) with a margin, and finish it."""
    middles = [0.5 * (min(values) + max(values)) for values in (east, north)]
    halves = [0.58 * (max(values) - min(values)) + 2.0 for values in (east, north)]
    halves = [max(half, 0.5 * max(halves)) for half in halves]  # no narrow strip around a straight track
    limits = [(middle - half, middle + half) for middle, half in zip(middles, halves, strict=True)]
    axes.set(xlim=limits[0], ylim=limits[1])
    finish_map(axes)


def finish_map(axes: Any) -> None:
    """Label a map whose limits are set, and add legend and scale bar beside it, where they cover nothing.

    The bar has a round length (m or km), at most a fifth of the map's width.
    """
    from matplotlib.transforms import ScaledTranslation
    from mpl_toolkits.axes_grid1.anchored_artists import AnchoredSizeBar

    (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
    wanted = 0.2 * (east - west)
    decade = 10.0 ** floor(log10(wanted))
    length = max(step * decade for step in (1.0, 2.0, 5.0) if step * decade <= wanted)
    text = f"{length / 1000:g} km" if length >= 1000.0 else f"{length:g} m"
    below = axes.transAxes + ScaledTranslation(
        0.0, -20.0 / 72.0, axes.figure.dpi_scale_trans
    )  # the numbers of the axis
    axes.add_artist(AnchoredSizeBar(
        axes.transData, length, f"{text}    N \N{UPWARDS ARROW}", "upper right", pad=0.0, borderpad=0.0, frameon=False,
        bbox_to_anchor=(1.0, 0.0), bbox_transform=below, size_vertical=0.006 * (north - south), fill_bar=True,
    ))  # fmt: skip
    axes.set(xlabel="east (m)", ylabel="north (m)", aspect="equal")
    add_legend(axes)
