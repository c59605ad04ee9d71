"""The form of a hull, for its buoyancy at the surface: a closed surface of triangles; and its area for the wind.

[hull]                                   # a table of the vehicle's file
file = "hull.stl"                        # closed, beside the vehicle's file, or
boxes = [[0.0, -0.4, 0.0, 2.0, 0.2, 0.3], [0.0, 0.4, 0.0, 2.0, 0.2, 0.3]]     # centre and size: a catamaran

[windage]                                # all that can be above the water
frontal_area = 0.35
lateral_area = 0.8
center = [0.0, 0.0, -0.3]
height = "0.6 m"

Without [hull] the hull is a box of the vehicle's `dimensions`. A hull of which only the water plane is known is a box
with the length and width that have its second moments.
"""

from array import array
from collections import Counter
from collections.abc import Sequence
from typing import Annotated, NamedTuple

from hil.common.errors import ConfigError
from hil.common.schema import Range

MAX_TRIANGLES = 20_000
MAX_BYTES = 8 << 20
_SOLID = b"solid"
Coordinate = Annotated[float, Range(-50.0, 50.0, "m")]
Length = Annotated[float, Range(0.001, 100.0, "m")]
Area = Annotated[float, Range(1e-4, 1000.0, "m²")]
Coefficient = Annotated[float, Range(0.05, 5.0)]
Box = tuple[Coordinate, Coordinate, Coordinate, Length, Length, Length]
Triangle = Sequence[float]  # three corners (m), counterclockwise seen from outside

# The corners of the two triangles of each side of a cube, as bits: forward, starboard, down.
_SIDES = (
    (0, 1, 2), (1, 3, 2), (4, 6, 5), (5, 6, 7), (0, 4, 1), (1, 4, 5), (2, 3, 6), (3, 7, 6), (0, 2, 4), (2, 6, 4),
    (1, 5, 3), (3, 5, 7),
)  # fmt: skip


class HullForm(NamedTuple):
    """The keys of the [hull] table of a vehicle's file: see the top of this module.

    `file` is an STL file in body axes, `scale` converts its numbers to metres. `boxes` are centre (m, body axes) and
    length, width, height (m) of closed boxes that do not overlap.
    """

    file: str = ""
    scale: Annotated[float, Range(1e-6, 1e3)] = 1.0
    boxes: tuple[Box, ...] = ()

    def validate(self) -> str | None:
        """Return what is wrong with the combination of the keys, or None."""
        return None if bool(self.file) != bool(self.boxes) else "give either file or boxes"


class Windage(NamedTuple):
    """What of a vehicle the wind can reach: areas seen from ahead and from the side, all of it out of the water.

    `center` is the centroid of the side area, in body axes, `height` its extent from the lower to the upper edge. The
    drag coefficients and the `coupling` of the two directions are Blendermann's of a speed boat.
    """

    frontal_area: Area
    lateral_area: Area
    center: tuple[Coordinate, Coordinate, Coordinate]
    height: Length
    frontal_drag: Coefficient = 0.55
    lateral_drag: Coefficient = 0.9
    coupling: Annotated[float, Range(0.0, 1.0)] = 0.6


def make_triangles(form: HullForm | None, dimensions: Sequence[float]) -> list[Triangle]:
    """Return a hull's form in body axes, without `form` that of a box of length, width and height `dimensions` (m).

    Raises ConfigError for a file that is no closed STL.
    """
    if form is None:
        return box_triangles((0.0, 0.0, 0.0, *dimensions))
    if form.boxes:
        return [triangle for box in form.boxes for triangle in box_triangles(box)]
    return load_stl(form.file, form.scale)


def box_triangles(box: Sequence[float]) -> list[Triangle]:
    """Return the twelve triangles of a box: centre x, y, z and length, width, height (m)."""
    x, y, z, length, width, height = box
    corners = [
        (x + (i - 0.5) * length, y + (j - 0.5) * width, z + (k - 0.5) * height)
        for i in (0, 1) for j in (0, 1) for k in (0, 1)
    ]  # fmt: skip
    return [(*corners[a], *corners[b], *corners[c]) for a, b, c in _SIDES]


def load_stl(path: str, scale: float = 1.0) -> list[Triangle]:
    """Return the triangles of an STL file, text or binary, in m. Raises ConfigError."""
    try:
        with open(path, "rb") as file:
            data = file.read(MAX_BYTES)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from None
    triangles = _text_triangles(data) if _is_text(data) else _binary_triangles(data)
    if not 4 <= len(triangles) <= MAX_TRIANGLES:
        raise ConfigError(f"{path}: no STL file of 4 to {MAX_TRIANGLES} triangles: simplify the hull, and export again")
    if not _is_closed(triangles):
        raise ConfigError(f"{path}: the surface is not closed: let a mesh program fill its holes and align its normals")
    return [[scale * number for number in triangle] for triangle in triangles]


def _is_text(data: bytes) -> bool:
    return data.lstrip()[: len(_SOLID)] == _SOLID and b"facet" in data[:1000]


def _text_triangles(data: bytes) -> list[list[float]]:
    lines = [line.split() for line in data.splitlines()]
    try:
        numbers = [float(word) for words in lines if words[:1] == [b"vertex"] for word in words[1:4]]
    except ValueError:
        return []
    return [numbers[i : i + 9] for i in range(0, len(numbers) - 8, 9)]


def _binary_triangles(data: bytes) -> list[list[float]]:
    """Return the triangles of a binary STL: 80 bytes, their number, then 50 bytes each, corners in 12 to 48."""
    count = int.from_bytes(data[80:84], "little")
    if len(data) < 84 + 50 * count or count > MAX_TRIANGLES:
        return []
    return [list(array("f", data[at + 12 : at + 48])) for at in range(84, 84 + 50 * count, 50)]


def _is_closed(triangles: Sequence[Triangle]) -> bool:
    """Return True if each edge is one of two triangles, once in each direction."""
    edges: Counter[tuple[tuple[float, ...], tuple[float, ...]]] = Counter()
    for row in triangles:
        a, b, c = tuple(row[0:3]), tuple(row[3:6]), tuple(row[6:9])
        edges.update(((a, b), (b, c), (c, a)))
    return all(count == edges[b, a] for (a, b), count in edges.items())
