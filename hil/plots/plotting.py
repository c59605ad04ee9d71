"""Import matplotlib on first use, for drawing into files."""

import os
from typing import Any

from hil.common.errors import ConfigError, MissingExtraError


def pyplot() -> Any:
    """matplotlib.pyplot, without a screen. Raises MissingExtraError."""
    try:
        import matplotlib as mpl
    except ImportError:
        raise MissingExtraError("the picture needs matplotlib: pip install 'uuv-hil[master]'") from None
    mpl.use("Agg")
    import matplotlib.pyplot as plt

    return plt


def check_picture(path: str) -> None:
    """That a picture can be drawn, of the kind that the file's name says. Raises MissingExtraError, ConfigError."""
    kinds = sorted(pyplot().FigureCanvasBase.get_supported_filetypes())
    if os.path.splitext(path)[1].removeprefix(".") not in kinds:
        raise ConfigError(f"{path}: pictures end in .{', .'.join(kinds)}")
