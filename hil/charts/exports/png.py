"""Write PNG images: 16-bit height maps and RGB colours."""

import io

import numpy as np
from numpy.typing import NDArray

from hil.charts.grid import write_file
from hil.common.errors import MissingExtraError


def write_png(image: NDArray[np.uint16] | NDArray[np.uint8], path: str) -> None:
    """Write an image: grey as (rows, columns) of 8 or 16 bits, or RGB as (rows, columns, 3) of 8 bits.

    Raises ConfigError if `path` cannot be written, MissingExtraError without Pillow.
    """
    try:
        from PIL import Image
    except ImportError:
        raise MissingExtraError(f"{path}: pictures need Pillow: pip install 'uuv-hil[imaging]'") from None
    encoded = io.BytesIO()
    Image.fromarray(image).save(encoded, "PNG")
    write_file(path, encoded.getvalue())
