"""Reads the content of a scene as the page does."""

import gzip
import json
from typing import Any

import numpy as np

from hil.view.scene.content import UNKNOWN_DEPTH, SceneContent, encode_content


def read(content: SceneContent) -> tuple[dict[str, Any], Any, Any]:
    """Return the words and numbers of a content, the depths (rows x columns, m) and the materials of the seabed."""
    data = gzip.decompress(encode_content(content))
    end = 4 + int.from_bytes(data[:4], "little")
    header = json.loads(data[4:end])
    world = header["world"]
    if world is None:
        return header, None, None
    size = world["rows"] * world["columns"]
    steps = np.frombuffer(data, "<u2", size, end).astype(float)
    depths = world["least"] + steps / (UNKNOWN_DEPTH - 1) * (world["deepest"] - world["least"])
    depths[steps == UNKNOWN_DEPTH] = np.nan
    codes = np.frombuffer(data, np.uint8, size, end + 2 * size)
    return header, depths.reshape(world["rows"], -1), codes.reshape(world["rows"], -1)
