"""Colours of mesh files: materials, textures and colours of corners as one reflectance of the whole mesh."""

import os
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from trimesh.resolvers import Resolver
from trimesh.visual.material import empty_material

from hil.common.tables import check_file

MAX_TEXTURE_BYTES = 64 << 20
MAX_TEXTURE_PIXELS = 1 << 26

Array = NDArray[np.float64]


class FolderResolver(Resolver):
    """Reads files that a mesh file names, if they are in its folder or below it."""

    def __init__(self, file: str) -> None:
        self._folder = os.path.realpath(os.path.dirname(file) or ".")

    def get(self, name: str) -> bytes:
        """Return the contents of a file. Raises OSError for one outside the folder, ConfigError for a large one."""
        path = os.path.realpath(os.path.join(self._folder, name.strip().replace("\\", "/")))
        if os.path.commonpath([path, self._folder]) != self._folder:
            raise FileNotFoundError(name)
        if os.path.isfile(path):
            check_file(path, MAX_TEXTURE_BYTES)
        with open(path, "rb") as stream:
            return stream.read()

    def write(self, name: str, data: Any) -> None:
        """Refuse to write: meshes are only read."""
        raise PermissionError(name)

    def keys(self) -> list[str]:
        """Return no names: files are found by the names in the mesh file."""
        return []

    def namespaced(self, _namespace: str) -> "FolderResolver":
        """Return itself: names in a mesh file are relative to its folder."""
        return self


def mean_reflectance(parts: Sequence[Any], is_linear: bool) -> tuple[float, float, float] | None:
    """Return the reflectance (red, green, blue; white: 1) of meshes with colours, weighted by area; None without any.

    Textures are sRGB, factors of materials linear, colours of corners linear if `is_linear` (glTF), else sRGB.
    """
    total, area = np.zeros(3), 0.0
    for part in parts:
        colours = _colours(part, is_linear)
        if colours is not None:
            sizes = np.nan_to_num(np.asarray(part.area_faces, float))
            total += (np.broadcast_to(colours, (len(sizes), 3)) * sizes[:, None]).sum(axis=0)
            area += float(sizes.sum())
    if area <= 0.0:
        return None
    red, green, blue = (round(min(max(float(share), 0.0), 1.0), 4) for share in total / area)
    return red, green, blue


def _colours(part: Any, is_linear: bool) -> Array | None:
    """Return the reflectance of a mesh, or of each of its triangles (n, 3); None if its file gives none."""
    visual = part.visual
    if visual.kind in ("vertex", "face"):
        shares = np.asarray(visual.face_colors, float)[:, :3] / 255.0
        return shares if is_linear else _to_linear(shares)
    if visual.kind != "texture":
        return None
    material = visual.material
    if hasattr(material, "baseColorFactor"):
        factor, image = material.baseColorFactor, material.baseColorTexture
    else:  # trimesh gives a material without a stated colour its own grey, as a colour or as an image
        factor, image = material.diffuse, material.image
        plain = empty_material()
        picture = plain.image
        if "kd" not in material.kwargs and tuple(factor) == tuple(plain.diffuse):
            factor = None
        if image is not None and image.size == picture.size and image.tobytes() == picture.tobytes():
            image = None
    shade = np.ones(3) if factor is None else np.asarray(factor, float)[:3] / 255.0
    pixels = _texture(image, visual.uv, np.asarray(part.faces))
    if pixels is not None:
        return _to_linear(pixels) * shade
    return None if factor is None else shade


def _texture(image: Any, uv: Any, faces: NDArray[np.int64]) -> Array | None:
    """Return the colour (0 to 1) of an image at the middle of each triangle, (n, 3); None without image or uv."""
    if image is None or uv is None or not len(uv) or image.width * image.height > MAX_TEXTURE_PIXELS:
        return None
    middles = np.asarray(uv, float)[faces].mean(axis=1) % 1.0
    middles = np.nan_to_num(middles)
    pixels = np.asarray(image.convert("RGB"))
    rows = np.minimum(((1.0 - middles[:, 1]) * pixels.shape[0]).astype(int), pixels.shape[0] - 1)
    columns = np.minimum((middles[:, 0] * pixels.shape[1]).astype(int), pixels.shape[1] - 1)
    return np.asarray(pixels[rows, columns], float) / 255.0


def _to_linear(shares: Array) -> Array:
    """Return the linear shares of sRGB ones, both 0 to 1."""
    return np.asarray(np.where(shares <= 0.04045, shares / 12.92, ((shares + 0.055) / 1.055) ** 2.4))
