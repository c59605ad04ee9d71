"""Exports of a world: grids, meshes, GeoTIFF, pictures and Gazebo worlds."""

import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
import rasterio
from numpy.typing import NDArray
from PIL import Image

from hil.charts.exports import mesh
from hil.charts.exports.gazebo import height_map, height_map_spacing, write_gazebo, write_png
from hil.charts.exports.geotiff import write_geotiff
from hil.charts.exports.mesh import triangulate, write_glb, write_stl
from hil.charts.grid import Grid, grid_of
from hil.common.errors import ConfigError, MissingExtraError
from hil.plots.stl import read_stl
from sim.environment.obstacles import Box, Cylinder
from sim.environment.world import World, load_world
from tests.support.lazy import import_lazily

trimesh = import_lazily("trimesh")

NORTH, EAST = np.arange(12)[:, None], np.arange(17)


def sloping(hole: bool = True) -> Grid:
    """Return a bed that deepens to the north and shoals to the east, with land in the south-east."""
    depths = (10.0 + 1.5 * NORTH - 1.0 * EAST).astype(np.float32)
    if hole:
        depths[9, 3] = np.nan
    return Grid(depths, -20.0, 40.0, 5.0)


def read_png(path: Path) -> NDArray[np.uint16]:
    """Read a grey picture of 16 bits."""
    with Image.open(path) as image:
        assert (image.format, image.mode) == ("PNG", "I;16")
        return np.asarray(image)


def test_the_grid_of_a_world_is_extracted() -> None:
    ridge = load_world("ridge")
    grid = grid_of(ridge)
    assert grid.extent == (-150.0, 150.0, -150.0, 150.0)
    assert grid.at(np.array([[0.0, 33.0], [100.0, -7.7]])) == pytest.approx([10.0, 25.0], abs=0.01)
    coarse = grid_of(ridge, 7.0)
    assert coarse.resolution == 7.0
    assert coarse.at(np.array([[-150.0 + 21 * 7.0, 4.0]])) == pytest.approx(ridge.seabed(-3.0, 4.0), abs=1e-4)
    flat = grid_of(load_world("pool"))
    assert (flat.depths == 5.0).all()
    assert flat.extent == (-10.0, 10.0, -10.0, 10.0)


def test_a_mesh_with_too_many_triangles_is_refused_with_a_size_that_fits(monkeypatch: pytest.MonkeyPatch) -> None:
    """A world of 10,001 x 10,001 nodes, 200 million triangles, is refused before memory runs out."""
    large = Grid(np.broadcast_to(np.float32(5.0), (10_001, 10_001)), 0.0, 0.0, 5.0)
    with pytest.raises(ConfigError, match=r"--resolution: 5 m makes a mesh of 10001 x 10001 nodes.*use 26 m"):
        triangulate(large)
    monkeypatch.setattr(mesh, "MAX_NODES", 12 * 17)
    assert len(triangulate(sloping(hole=False))[1]) == 2 * 11 * 16


def test_grid_values_are_interpolated_and_undefined_outside() -> None:
    grid = sloping()
    assert grid.at(np.array([[-20.0, 40.0], [-17.5, 42.5], [35.0, 120.0]])) == pytest.approx([10.0, 10.25, 10.5])
    assert np.isnan(grid.at(np.array([[-20.1, 40.0], [35.0, 120.1], [24.0, 56.0]]))).all()


def test_an_stl_file_has_the_depths(tmp_path: Path) -> None:
    path = tmp_path / "bed.stl"
    grid = sloping()
    write_stl(grid, str(path))
    triangles = read_stl(str(path))
    assert len(triangles) == 2 * (11 * 16) - 6, "a node without a depth takes six triangles with it"
    corners = triangles.reshape(-1, 3)
    assert sloping(hole=False).at(corners[:, 1::-1]) == pytest.approx(-corners[:, 2], abs=1e-4)
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    assert (normals[:, 2] > 0.0).all(), "seen from above"
    area = 0.5 * np.linalg.norm(normals, axis=1).sum()
    assert area == pytest.approx((11 * 16 * 25.0 - 6 * 12.5) * np.sqrt(1.0 + 0.3**2 + 0.2**2), rel=1e-6)


def test_a_grid_without_known_cells_has_no_mesh() -> None:
    with pytest.raises(ConfigError, match="no cell with four known depths"):
        triangulate(Grid(np.full((4, 4), np.nan, np.float32), 0.0, 0.0, 1.0))


def test_a_glb_file_has_the_same_triangles(tmp_path: Path) -> None:
    path = tmp_path / "bed.glb"
    grid = sloping()
    write_glb(grid, str(path))
    read = trimesh.load_mesh(str(path), process=False)
    corners, triangles = triangulate(grid)
    assert (read.faces == triangles).all()
    assert (read.vertices == np.column_stack([corners[:, 0], corners[:, 2], -corners[:, 1]])).all()
    assert path.stat().st_size % 4 == 0


def test_a_geotiff_has_its_depths_and_position(tmp_path: Path) -> None:
    path = tmp_path / "bed.tif"
    grid = sloping()
    write_geotiff(grid, (59.5, -151.25), str(path))
    with rasterio.open(path) as source:
        assert (source.width, source.height, source.dtypes) == (17, 12, ("float32",))
        assert np.array_equal(source.read(1)[::-1], -grid.depths, equal_nan=True)
        assert np.isnan(source.nodata)
        assert source.tags()["AREA_OR_POINT"] == "Point"
        assert source.res == (5.0, 5.0)
        assert source.xy(0, 0) == (40.0, 35.0), "the first pixel's centre is the first node, east and north"
        projection = source.crs.to_dict()
        assert projection["proj"] == "tmerc"
        assert (projection["lat_0"], projection["lon_0"]) == (59.5, -151.25)


def test_a_geotiff_without_an_origin_is_local(tmp_path: Path) -> None:
    path = tmp_path / "bed.tif"
    write_geotiff(sloping(), None, str(path))
    with rasterio.open(path) as source:
        assert not (source.crs and (source.crs.is_projected or source.crs.is_geographic))
        assert source.xy(0, 0) == (40.0, 35.0)


def test_an_export_without_its_library_names_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rasterio", None)
    monkeypatch.setitem(sys.modules, "PIL", None)
    with pytest.raises(MissingExtraError, match=r"uuv-hil\[raster\]"):
        write_geotiff(sloping(), None, str(tmp_path / "bed.tif"))
    with pytest.raises(MissingExtraError, match=r"uuv-hil\[imaging\]"):
        write_png(np.zeros((2, 2), np.uint8), str(tmp_path / "p.png"))


def test_a_gazebo_world_has_terrain_and_obstacles(tmp_path: Path) -> None:
    grid = sloping()
    world = World(
        "bay", "a chart -- and more", (-20.0, 35.0, 40.0, 120.0), 30.0, origin=(59.5, -151.25),
        cylinder=(Cylinder(20.0, 60.0, 2.0, 4.0), Cylinder(-20.0, 119.0, 1.0)),
        box=(Box(10.0, 50.0, 8.0, 2.0, 0.5, 3.0),),
    )  # fmt: skip
    rounding = write_gazebo(world, grid, str(tmp_path / "bay.sdf"))
    low, high = -float(np.nanmax(grid.depths)), -float(np.nanmin(grid.depths))
    assert rounding == pytest.approx((high - low) / 65535 / 2)
    root = ElementTree.parse(tmp_path / "bay.sdf").getroot()
    assert root.get("version") == "1.9"
    maps = root.findall(".//heightmap")
    assert len(maps) == 2
    for field in maps:
        size, middle = ([float(x) for x in (field.findtext(key) or "").split()] for key in ("size", "pos"))
        assert size == pytest.approx([80.0, 55.0, high - low], abs=1e-3)
        assert middle == pytest.approx([80.0, 7.5, low], abs=1e-3)
        assert (tmp_path / (field.findtext("uri") or "")).exists()
    for picture in (root.findtext(".//diffuse"), root.findtext(".//normal")):
        assert (tmp_path / (picture or "")).exists()
    assert root.findtext(".//latitude_deg") == "59.500000000"
    poses = {m.get("name"): [float(x) for x in (m.findtext("pose") or "0").split()] for m in root.findall(".//model")}
    bed = 10.0 + 1.5 * 8 - 4.0
    assert poses["obstacle_0"][:3] == pytest.approx([60.0, 20.0, -0.5 * (bed + 4.0)])
    assert float(root.findtext(".//cylinder/length") or 0.0) == pytest.approx(bed - 4.0)
    assert poses["obstacle_2"][5] == pytest.approx(np.pi / 2 - 0.5)
    heights = read_png(tmp_path / "bay_heights.png")
    assert heights.shape == (17, 17)
    metres = low + heights / 65535 * (high - low)
    rows = np.linspace(35.0, -20.0, 17)  # the first row is the north
    assert metres[:, 0] == pytest.approx(-(10.0 + 0.3 * (rows + 20.0)), abs=rounding * 1.01, rel=0.0)
    assert metres[0, 0] == pytest.approx(-26.5, abs=rounding * 1.01)
    assert metres[-1, -1] == pytest.approx(6.0, abs=rounding * 1.01)


@pytest.mark.parametrize(("nodes", "side"), [(2, 3), (17, 17), (18, 33), (300, 513)])
def test_height_maps_are_square_with_a_side_of_a_power_of_two_plus_one(nodes: int, side: int) -> None:
    image, _, _ = height_map(Grid(np.random.default_rng(1).random((2, nodes)).astype(np.float32), 0.0, 0.0, 1.0))
    assert image.shape == (side, side)
    assert (image.min(), image.max()) == (0, 65535)


def test_a_height_map_has_at_most_2049_nodes_a_side() -> None:
    """Gazebo takes 2^n + 1 nodes a side, and we give it 2,049 at most."""
    for side, apart in ((100, 99.0 / 128.0), (2049, 1.0), (9999, 9998.0 / 2048.0)):
        assert height_map_spacing(Grid(np.broadcast_to(np.float32(9.0), (side, 2)), 0.0, 0.0, 1.0)) == pytest.approx(
            apart
        )
