"""Write a grid as a GeoTIFF: heights in float32 on a transverse Mercator plane with the world's origin."""

import struct

import numpy as np

from hil.charts.grid import Grid, write_file

_SHORT, _LONG, _DOUBLE, _ASCII = (
    (3, "H", 2),
    (4, "I", 4),
    (12, "d", 8),
    (2, "s", 1),
)  # type in the file, struct's, bytes


def write_geotiff(grid: Grid, origin: tuple[float, float] | None, path: str) -> None:
    """Write heights above the water in m (land positive) to `path`; nan where nothing is known. Raises ConfigError.

    Rows go from north to south, values are those of the nodes (PixelIsPoint). `origin`: latitude and longitude in
    degrees of (0, 0); None leaves the coordinate system out. The tangent plane and transverse Mercator differ by
    2 mm at 5 km from the origin and 0.1 m at 17 km. After TIFF 6.0 and OGC GeoTIFF 1.1.
    """
    rows, columns = grid.depths.shape
    image = np.ascontiguousarray(-grid.depths[::-1], "<f4").tobytes()
    _, north, west, _ = grid.extent
    keys, numbers = _projection(origin)
    tags = [
        (256, _LONG, [columns]), (257, _LONG, [rows]), (258, _SHORT, [32]), (259, _SHORT, [1]), (262, _SHORT, [1]),
        (273, _LONG, [0]), (277, _SHORT, [1]), (278, _LONG, [rows]), (279, _LONG, [len(image)]), (339, _SHORT, [3]),
        (33550, _DOUBLE, [grid.resolution, grid.resolution, 0.0]),
        (33922, _DOUBLE, [0.0, 0.0, 0.0, west, north, 0.0]),
        (34735, _SHORT, keys), (34736, _DOUBLE, numbers), (42113, _ASCII, [b"nan\0"]),
    ]  # fmt: skip
    write_file(path, _directory([tag for tag in tags if tag[2]]) + image)


def _projection(origin: tuple[float, float] | None) -> tuple[list[int], list[float]]:
    """Return the GeoKeys: a head, then (key, where its value is, how many, value or index)."""
    if origin is None:
        return [1, 1, 0, 1, 1025, 0, 1, 2], []
    latitude, longitude = origin
    numbers = [longitude, latitude, 0.0, 0.0, 1.0]  # then false easting and northing, and the scale
    plain = [(1024, 1), (1025, 2), (2048, 4326), (3072, 32767), (3074, 32767), (3075, 1), (3076, 9001)]
    placed = [(3080, 0), (3081, 1), (3082, 2), (3083, 3), (3092, 4)]
    entries = [(key, 0, 1, value) for key, value in plain] + [(key, 34736, 1, index) for key, index in placed]
    return [1, 1, 0, len(entries), *(word for entry in entries for word in entry)], numbers


def _directory(tags: list[tuple[int, tuple[int, str, int], list[int] | list[float] | list[bytes]]]) -> bytes:
    """Header and directory of a TIFF whose image follows at once; tag 273 comes to say where."""
    start = 8 + 2 + 12 * len(tags) + 4
    packed = [_pack(form, values) for _, form, values in tags]
    end = start + sum(len(data) + len(data) % 2 for data in packed if len(data) > 4)
    entries, beyond = b"", b""
    for (number, (code, _, size), values), data in zip(tags, packed, strict=True):
        if number == 273:
            data = struct.pack("<I", end)
        entries += struct.pack("<HHI", number, code, len(data) // size if code == 2 else len(values))
        if len(data) <= 4:
            entries += data.ljust(4, b"\0")
        else:
            entries += struct.pack("<I", start + len(beyond))
            beyond += data + b"\0" * (len(data) % 2)
    return struct.pack("<2sHIH", b"II", 42, 8, len(tags)) + entries + struct.pack("<I", 0) + beyond


def _pack(form: tuple[int, str, int], values: list[int] | list[float] | list[bytes]) -> bytes:
    if form is _ASCII:
        return b"".join(value for value in values if isinstance(value, bytes))
    return struct.pack(f"<{len(values)}{form[1]}", *values)
