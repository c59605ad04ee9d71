"""Occupancy grids: orientation above all, inflation, lines of sight and the files of map_server."""

import math
import os
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.autonomy.paths.occupancy import STRIP, Extent, OccupancyGrid
from hil.common.errors import ConfigError

# 4 rows to the north, 5 columns to the east; "#" is occupied; north is up, as on a map
PICTURE = (
    "#....",
    "....#",
    ".....",
    "..#..",
)


def grid_of(
    picture: tuple[str, ...], resolution: float = 1.0, origin: tuple[float, float] = (0.0, 0.0)
) -> OccupancyGrid:
    rows = [[letter == "#" for letter in line] for line in reversed(picture)]
    return OccupancyGrid(np.array(rows), resolution, origin)


def picture_of(grid: OccupancyGrid) -> tuple[str, ...]:
    return tuple("".join("#" if cell else "." for cell in row) for row in grid.cells[::-1])


def test_rasterise_places_an_asymmetric_world_correctly() -> None:
    """The map has one round obstacle in the north-west, by its distance."""
    extent = Extent(south=-10.0, west=20.0, north=10.0, east=50.0)

    def clearance(north: Any, east: Any) -> Any:
        return np.hypot(north - 6.0, east - 24.0) - 2.0

    grid = OccupancyGrid.rasterise(clearance, extent, 0.5)
    assert grid.cells.shape == (40, 60)
    assert not grid.is_free((6.0, 24.0))
    assert all(grid.is_free(mirrored) for mirrored in [(-6.0, 24.0), (6.0, 46.0), (-6.0, 46.0)])
    north, east = np.argwhere(grid.cells).mean(axis=0) + 0.5
    assert (-10.0 + 0.5 * north, 20.0 + 0.5 * east) == pytest.approx((6.0, 24.0))
    assert grid.cells.sum() * 0.25 == pytest.approx(math.pi * 4.0, rel=0.05)


def test_an_extent_that_is_no_multiple_of_the_cell_is_covered() -> None:
    grid = OccupancyGrid.empty(Extent(0.0, 0.0, 1.05, 0.3), 0.1)
    assert grid.cells.shape == (11, 3)
    with pytest.raises(ConfigError, match="no cell"):
        OccupancyGrid.empty(Extent(0.0, 0.0, 0.0, 1.0), 0.1)


def test_cells_and_points_convert_both_ways() -> None:
    grid = grid_of(PICTURE, 0.5, (-1.0, 10.0))
    assert grid.cell((-1.0, 10.0)) == (0, 0)
    assert grid.cell((-0.01, 11.6)) == (1, 3)
    assert grid.centre((1, 3)) == pytest.approx((-0.25, 11.75))
    assert grid.cell(grid.centre((2, 4))) == (2, 4)
    assert not grid.is_free((-0.8, 11.2))  # the post in the south
    assert not grid.is_free((0.9, 10.2))  # the one in the north-west
    assert grid.contains((0.99, 12.49))
    assert not any(map(grid.contains, [(1.01, 10.2), (-1.01, 10.2), (0.0, 9.9), (0.0, 12.6)]))
    assert not grid.is_free((5.0, 5.0))


def test_nearest_free_finds_the_nearest_free_cell() -> None:
    grid = grid_of(("###.", "####", "####"))
    assert grid.nearest_free((0.1, 0.1)) == (2.5, 3.5)
    assert grid_of(PICTURE).nearest_free((0.5, 2.4)) == (0.5, 1.5)
    assert grid_of(("##", "##")).nearest_free((0.0, 0.0)) is None


@pytest.mark.parametrize("radius", [0.0, 0.5, 1.0, 1.5, 2.0, 3.3, 50.0])
def test_inflate_grows_a_cell_to_a_disc(radius: float) -> None:
    generator = np.random.default_rng(1)
    cells = generator.random((23, 17)) < 0.03
    grown = OccupancyGrid(cells, 0.5, (3.0, 4.0)).inflate(radius)
    rows, columns = np.indices(cells.shape)
    expected = np.zeros_like(cells)
    for row, column in np.argwhere(cells):
        expected |= np.hypot(rows - row, columns - column) * 0.5 <= radius + 1e-9
    assert np.array_equal(grown.cells, expected)
    assert (grown.resolution, grown.origin) == (0.5, (3.0, 4.0))


def test_lines_of_sight_are_correct_through_corners_and_along_edges() -> None:
    grid = grid_of(("..", "#."))
    assert grid.line_is_free((1.5, 0.5), (1.5, 1.5))
    assert grid.line_is_free((1.5, 1.5), (0.5, 1.5))
    assert not grid.line_is_free((1.5, 0.5), (0.5, 1.5))  # past the corner of the occupied cell
    assert not grid.line_is_free((1.0, 0.1), (1.0, 1.9))  # along its edge
    assert not grid.line_is_free((1.5, 1.5), (1.5, 2.5))  # off the map
    assert grid.line_is_free((1.5, 1.5), (1.5, 1.5))
    assert not grid.line_is_free((0.5, 0.5), (0.5, 0.5))


POINTS = st.tuples(st.floats(0.01, 7.99), st.floats(0.01, 7.99))


@given(st.integers(0, 2**32 - 1), POINTS, POINTS)
def test_line_of_sight_agrees_with_sampling_the_line(
    seed: int, start: tuple[float, float], end: tuple[float, float]
) -> None:
    grid = OccupancyGrid(np.random.default_rng(seed).random((8, 8)) < 0.2, 1.0, (0.0, 0.0))
    shares = np.linspace(0.0, 1.0, 2001)
    north = start[0] + shares * (end[0] - start[0])
    east = start[1] + shares * (end[1] - start[1])
    hit = grid.cells[north.astype(int), east.astype(int)].any()
    if hit:
        assert not grid.line_is_free(start, end)
    elif not grid.line_is_free(start, end):  # then it at least grazes one
        near = [
            grid.cells[np.clip(north + a, 0, 7.999).astype(int), np.clip(east + b, 0, 7.999).astype(int)].any()
            for a in (-0.01, 0.0, 0.01)
            for b in (-0.01, 0.0, 0.01)
        ]
        assert any(near)


def test_pgm_files_have_the_format_of_map_server(tmp_path: Any) -> None:
    """The file has north at the top, west at the left, 254 for free and 0 for occupied, byte by byte."""
    path = os.path.join(tmp_path, "reef.pgm")
    grid_of(PICTURE, 0.25, (-3.0, 7.5)).write_pgm(path)
    with open(path, "rb") as file:
        data = file.read()
    assert data.startswith(b"P5\n5 4\n255\n")
    image = data.removeprefix(b"P5\n5 4\n255\n")
    assert image == bytes(0 if letter == "#" else 254 for letter in "".join(PICTURE))
    with open(os.path.join(tmp_path, "reef.yaml"), encoding="utf-8") as file:
        settings = dict(line.strip().split(": ", 1) for line in file)
    assert settings == {
        "image": "reef.pgm",
        "mode": "trinary",
        "resolution": "0.250000000",
        "origin": "[7.500000000, -3.000000000, 0.0]",  # x is east, y is north
        "negate": "0",
        "occupied_thresh": "0.65",
        "free_thresh": "0.196",
    }


def test_written_maps_are_read_back_equal(tmp_path: Any) -> None:
    path = os.path.join(tmp_path, "reef.pgm")
    grid_of(PICTURE, 0.1, (-3.0, 7.5)).write_pgm(path)
    grid = OccupancyGrid.read(os.path.join(tmp_path, "reef.yaml"))
    assert picture_of(grid) == PICTURE
    assert (grid.resolution, *grid.origin) == pytest.approx((0.1, -3.0, 7.5))


def test_maps_written_by_map_saver_are_read(tmp_path: Any) -> None:
    """The file has comments in both parts, unknown cells (205, occupied) and a raster that begins like blanks."""
    with open(os.path.join(tmp_path, "m.pgm"), "wb") as image:
        image.write(b"P5\n# CREATOR: map_saver.cpp 0.050 m/pix\n3 2\n255\n" + bytes([32, 254, 254, 205, 0, 254]))
    with open(os.path.join(tmp_path, "m.yaml"), "w", encoding="utf-8") as text:
        text.write(
            'image: "m.pgm"  # beside\nresolution: 0.05\norigin: [-2.3, -1.69, 0]\nnegate: 0\nfree_thresh: 0.196\n'
        )
    grid = OccupancyGrid.read(os.path.join(tmp_path, "m.yaml"))
    assert picture_of(grid) == ("#..", "##.")
    assert grid.origin == (-1.69, -2.3)


GOOD_YAML = "image: m.pgm\nresolution: 0.1\norigin: [0, 0, 0]\nfree_thresh: 0.2\n"
GOOD_PGM = b"P5 1 1 255\n\0"


@pytest.mark.parametrize(
    ("yaml", "pgm", "expected_text"),
    [
        (GOOD_YAML.replace("0.1", "nan"), GOOD_PGM, "resolution of nan m"),
        (GOOD_YAML.replace("0.1", "inf"), GOOD_PGM, "resolution of inf m"),
        (GOOD_YAML.replace("0.1", "1e-300"), GOOD_PGM, "resolution of 1e-300 m"),
        (GOOD_YAML.replace("[0, 0, 0]", "[nan, 0, 0]"), GOOD_PGM, "origin beyond"),
        (GOOD_YAML.replace("[0, 0, 0]", "[0, 1e300, 0]"), GOOD_PGM, "origin beyond"),
        (GOOD_YAML.replace("0.2", "nan"), GOOD_PGM, "no share: nan"),
        (GOOD_YAML.replace("0.1", "9" * 100_000 + "x"), GOOD_PGM, "not a map of map_server"),
        ("x" * (1 << 20) + ": y\n", GOOD_PGM, "at most 1 MiB"),
        (GOOD_YAML, b"P5 " + b"#\n" * 500_000 + b"1 1 255\n\0", "not an 8-bit P5"),
        (GOOD_YAML, b"P5 999999999 999999999 255\n\0", "not a map of map_server"),
        (GOOD_YAML, b"P5 " + b"9" * 100_000 + b" 1 255\n\0", "not an 8-bit P5"),
        (GOOD_YAML, b"P5 -1 1 255\n\0", "not an 8-bit P5"),
        (GOOD_YAML, b"P2 1 1 255\n0", "not an 8-bit P5"),
        (GOOD_YAML, b"P5 4", "not an 8-bit P5"),
        (GOOD_YAML, b"P5 4 4 255\n\0", r"m\.yaml: not a map of map_server"),
        (GOOD_YAML.replace("[0, 0, 0]", "[0, 0, 0.5]"), GOOD_PGM, "a turned map"),
        (GOOD_YAML.replace("[0, 0, 0]", "[0, 0]"), GOOD_PGM, r"m\.yaml: not a map of map_server"),
        (GOOD_YAML.replace("0.1", "0"), GOOD_PGM, "resolution of 0.0 m"),
        (GOOD_YAML.replace("image", "no"), GOOD_PGM, r"m\.yaml: not a map of map_server"),
        (GOOD_YAML.replace("m.pgm", "no.pgm"), GOOD_PGM, r"no\.pgm"),
    ],
)
def test_wrong_and_hostile_maps_are_refused_with_a_one_line_error(
    tmp_path: Any, yaml: str, pgm: bytes, expected_text: str
) -> None:
    (tmp_path / "m.pgm").write_bytes(pgm)
    (tmp_path / "m.yaml").write_text(yaml, encoding="utf-8")
    with pytest.raises(ConfigError, match=expected_text) as error:
        OccupancyGrid.read(str(tmp_path / "m.yaml"))
    assert len(str(error.value)) < len(str(tmp_path)) + 350


def test_a_large_map_is_rasterised_in_strips_and_a_too_large_one_refused() -> None:
    """The map is made in pieces of no more than STRIP cells, in strips of two rows at least."""
    sizes: list[tuple[int, int]] = []

    def clearance(north: Any, east: Any) -> Any:
        sizes.append(north.shape)
        return np.hypot(north - 700.0, east - 900.0) - 100.0

    grid = OccupancyGrid.rasterise(clearance, Extent(0.0, 0.0, 1401.0, 2000.0), 1.0)
    assert len(sizes) > 2
    assert max(rows * columns for rows, columns in sizes) <= STRIP + 2 * 2000
    assert min(rows for rows, _ in sizes) >= 2
    assert sum(rows for rows, _ in sizes) == 1401
    north, east = np.meshgrid(np.arange(1401) + 0.5, np.arange(2000) + 0.5, indexing="ij")
    assert (grid.cells == (np.hypot(north - 700.0, east - 900.0) <= 100.0)).all()
    with pytest.raises(ConfigError, match=r"200000 x 200000 cells of 0.25 m are more than .*: make .* 3.06 m"):
        OccupancyGrid.empty(Extent(0.0, 0.0, 50_000.0, 50_000.0), 0.25)
