"""Common functions of all figures: import matplotlib on first use, check and save files, add legends."""

import os
from typing import Any

from hil.common.errors import ConfigError, MissingExtraError

DPI = 110


def pyplot() -> Any:
    """Return matplotlib.pyplot with a backend that needs no screen. Raises MissingExtraError."""
    try:
        import matplotlib as mpl
    except ImportError:
        raise MissingExtraError("the picture needs matplotlib: pip install 'uuv-hil[master]'") from None
    mpl.use("Agg")
    import matplotlib.pyplot as plt

    return plt


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
    """Add a legend to the right of the axes, where it covers no curve. Without labels it adds nothing."""
    if axes.get_legend_handles_labels()[1]:
        axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0, fontsize="small", **options)
