"""Depths at 20 places against the truth that a file was written with: NetCDF, GeoTIFF and LAS in many variants."""

from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from hil.charts.build import build
from hil.charts.projection import LocalPlane
from hil.charts.sources.combine import read_sources
from hil.charts.sources.points import read_points
from hil.charts.sources.rasters import open_raster
from hil.charts.sources.sign import Declared
from hil.common.errors import ConfigError

Array = NDArray[np.float64]

h5py = pytest.importorskip("h5py", reason="writes the NetCDF for this test")
rasterio = pytest.importorskip("rasterio", reason="rasters need rasterio: pip install 'uuv-hil[raster]'")
warp = pytest.importorskip("rasterio.warp")
MIDDLE = (54.05, 10.075)
NAMES = {"latitude": ("degrees_north", "Y"), "longitude": ("degrees_east", "X"), "time": ("days since 2000-01-01", "T")}


def truth(latitude: Array, longitude: Array) -> Array:
    return 40.0 + 300.0 * (latitude - 54.0) - 150.0 * (longitude - 10.0)


def write_netcdf(
    path: Path, dims: str = "yx", north: int = 1, east: int = 1, names: str = "lat lon", states: str = "sua",
    uneven: bool = False, classic: bool = False, kind: str = "f4", stored: tuple[float, float] = (1.0, 0.0),
    shift: float = 0.0, name: str = "depth", hole: float | None = None, **attributes: Any
) -> str:  # fmt: skip
    """Write depths with `dims` in this order; axes state s(tandard_name), u(nits), a(xis); `stored`: scale, offset."""
    along = 54.0 + 0.1 * np.linspace(0.0, 1.0, 41) ** (1.5 if uneven else 1.0)
    across = np.linspace(10.0, 10.15, 61)
    latitude, longitude = along[::north], across[::east]
    depths = np.stack([truth(latitude[:, None], longitude) + 5.0 * time for time in range(3)])
    wrapped = (longitude + shift + 180.0) % 360.0 - 180.0 if shift else longitude
    axes = dict(zip("tyx", (np.arange(3.0), latitude, wrapped), strict=True))
    labels = dict(zip("tyx", ("time", *names.split()), strict=True))
    said: dict[str, dict[str, Any]] = {}
    for axis, standard in zip("tyx", ("time", "latitude", "longitude"), strict=True):
        own = dict(
            zip(
                "sua", (("standard_name", standard), *zip(("units", "axis"), NAMES[standard], strict=True)), strict=True
            )
        )
        said[labels[axis]] = dict(own[key] for key in states)
    values = ((depths - stored[1]) / stored[0]).transpose(["tyx".index(axis) for axis in "tyx"])
    values = np.einsum("tyx->" + dims, values) if "t" in dims else np.einsum("yx->" + dims, values[0])
    values = values.astype(kind) if kind[0] == "f" else np.round(values).astype(kind)
    said[name] = {"units": "m"} | attributes
    if stored != (1.0, 0.0):
        said[name] |= {"scale_factor": stored[0], "add_offset": stored[1]}
    if hole is not None:
        values[:2, :2] = hole
        said[name]["_FillValue"] = values.dtype.type(hole)
    arrays = {**{labels[axis]: (axis, axes[axis]) for axis in dims}, name: (dims, values)}
    if classic:
        from scipy.io import netcdf_file

        with netcdf_file(path, "w") as file:
            for axis in dims:
                file.createDimension(labels[axis], len(axes[axis]))
            for key, (own_dims, array) in arrays.items():
                made = file.createVariable(key, array.dtype.newbyteorder(">"), [labels[axis] for axis in own_dims])
                made[:] = array
                vars(made).update(said[key]), made._attributes.update(said[key])
        return str(path)
    with h5py.File(path, "w") as file:
        for key, (own_dims, array) in arrays.items():
            file[key] = array
            file[key].attrs.update({k: np.bytes_(v) if isinstance(v, str) else v for k, v in said[key].items()})
            if key != name:
                file[key].make_scale(key)
                continue
            for number, axis in enumerate(own_dims):
                file[key].dims[number].attach_scale(file[labels[axis]])
    return str(path)


def at_places(path: str, shift: float = 0.0, truth: Callable[[Array, Array], Array] = truth, **options: Any) -> str:
    """Hold the depths at 20 places, whose positions come from PROJ, against the truth; return the notes."""
    step = np.arange(-3000.0, 3001.0, 125.0)
    north, east = (part.ravel() for part in np.meshgrid(step[::12], step[::16], indexing="ij"))
    local = f"+proj=ortho +lat_0={MIDDLE[0]} +lon_0={MIDDLE[1]} +datum=WGS84"
    longitude, latitude = (np.array(part) for part in warp.transform(local, "EPSG:4326", east, north))
    found = open_raster(path, Declared(**options))
    plane = LocalPlane(MIDDLE[0], (MIDDLE[1] + shift + 180.0) % 360.0 - 180.0)
    depths = found.depths(plane, step, step)[::12, ::16].ravel()
    assert depths == pytest.approx(truth(latitude, longitude), abs=0.06)
    return found.note


ORDERS = [
    {"dims": dims, "north": north, "east": east, "classic": classic}
    for dims, north, east, classic in product(("yx", "xy", "tyx", "yxt", "ytx", "xyt"), (1, -1), (1, -1), (False, True))
]


@pytest.mark.parametrize("variant", ORDERS, ids=lambda variant: "_".join(map(str, variant.values())))
def test_axes_of_any_order_and_direction(variant: dict[str, Any], tmp_path: Path) -> None:
    note = at_places(write_netcdf(tmp_path / "a.nc", **variant))
    assert ("3 layers along time: the first is used, 2000-01-01" in note) == ("t" in variant["dims"])


@pytest.mark.parametrize("variant", [
    *({"names": names, "states": states, "dims": dims} for names, states, dims in product(
        ("a b", "x y", "lon lat"), ("s", "u", "sua"), ("yx", "xy"))),
    {"names": "a b", "states": "a"}, {"names": "lat lon", "states": ""}, {"names": "y x", "states": ""},
    {"kind": "f8"}, {"kind": "i2", "stored": (0.01, 0.0), "hole": -32768}, {"hole": 9e36},
    {"kind": "i2", "stored": (-0.01, 10.0), "hole": -32768, "dims": "xy"}, {"hole": 9e36, "dims": "xy"},
    {"uneven": True}, {"uneven": True, "dims": "xy", "north": -1}, {"uneven": True, "classic": True},
    *({"shift": shift, "dims": dims, "east": east} for shift, dims, east in product(
        (169.95, -10.0, 185.0), ("yx", "xy"), (1, -1))),
    {"name": "Band1", "standard_name": "sea_floor_depth_below_geoid"}, {"name": "z", "positive": "down"},
], ids=str)  # fmt: skip
def test_names_types_and_positions(variant: dict[str, Any], tmp_path: Path) -> None:
    note = at_places(write_netcdf(tmp_path / "a.nc", **variant), variant.get("shift", 0.0))
    assert ("uneven" in note) == ("uneven" in variant)


def test_feet_heights_times_and_variables(tmp_path: Path) -> None:
    def feet(latitude: Array, longitude: Array) -> Array:
        return 0.3048 * truth(latitude, longitude)

    at_places(write_netcdf(tmp_path / "a.nc", units="feet"), truth=feet)
    assert "states depths in m; --unit ft is used" in at_places(write_netcdf(tmp_path / "b.nc"), truth=feet, unit="ft")
    note = at_places(write_netcdf(tmp_path / "f.nc", units="furlong"), unit="m")
    assert "states depths in furlong; --unit m is used" in note
    at_places(write_netcdf(tmp_path / "c.nc", name="altitude"), truth=lambda y, x: -truth(y, x))
    times = write_netcdf(tmp_path / "d.nc", dims="ytx")
    assert not at_places(times, truth=lambda y, x: truth(y, x) + 10.0, layer="depth:3")
    with pytest.raises(ConfigError, match=r"--layer :4: depth of .* has 3"):
        open_raster(times, Declared(layer="4"))
    two = write_netcdf(tmp_path / "e.nc", name="depth_smoothed")
    with h5py.File(two, "a") as file:
        file["depth"] = file["depth_smoothed"][:] + 7.0
        for number, axis in enumerate(("lat", "lon")):
            file["depth"].dims[number].attach_scale(file[axis])
    note = at_places(two, truth=lambda y, x: truth(y, x) + 7.0)
    assert "depth is used (--layer for depth_smoothed)" in note
    assert not at_places(two, layer="depth_smoothed")
    with pytest.raises(ConfigError, match=r"--layer sand: .* has depth, depth_smoothed"):
        open_raster(two, Declared(layer="sand"))


def bent(row: Array, column: Array, place: str) -> tuple[Array, Array, Array]:
    """Return latitude, longitude and depth on bent rows and columns, -1 to 1 each: a plane here or at the pole."""
    north, east = 0.05 * row + 0.03 * column + 0.01 * row * column, 0.09 * column - 0.05 * row + 0.01 * column**2
    if place == "pole":
        return 90.0 - np.hypot(north, east), np.degrees(np.arctan2(east, north)), 50.0 + 300.0 * north - 150.0 * east
    depths = truth(MIDDLE[0] + north, MIDDLE[1] + east)
    return MIDDLE[0] + north, (MIDDLE[1] + east + 170.0 * (place == "date line")) % 360.0, depths


@pytest.mark.parametrize("place", ["here", "date line", "pole"])
def test_curved_grids_are_interpolated(place: str, tmp_path: Path) -> None:
    """A plane is exact between the nodes, also over the date line and a pole; the hole and the outside have none."""
    latitude, longitude, depths = bent(
        *np.meshgrid(np.linspace(-1.0, 1.0, 41), np.linspace(-1.0, 1.0, 61), indexing="ij"), place
    )
    depths[30:32, 10:12] = np.nan
    with h5py.File(tmp_path / "a.nc", "w") as file:
        for name, size in (("row", 41), ("column", 61)):
            file[name] = np.arange(float(size))
            file[name].make_scale(name)
        for name, unit, values in (
            ("lat", "degrees_north", latitude), ("lon", "degrees_east", (longitude + 180.0) % 360.0 - 180.0),
            ("depth", "m", depths),
        ):  # fmt: skip
            file[name] = values
            file[name].attrs["units"] = np.bytes_(unit)
            for number, axis in enumerate(("row", "column")):
                file[name].dims[number].attach_scale(file[axis])
        file["depth"].attrs["coordinates"] = np.bytes_("lat lon")
    raster = open_raster(str(tmp_path / "a.nc"))
    assert "a.nc: its positions have two dimensions: interpolated to even ones" in raster.note
    for row, column in product([-0.8, -0.31, 0.013, 0.525, 0.84, 1.2], [-0.65, -0.3, 0.011, 0.4, 0.8, 1.2]):
        at, across, depth = (part.item() for part in bent(np.array(row), np.array(column), place))
        found = raster.depths(LocalPlane(at, across), np.array([-1.0, 0.0, 1.0]), np.array([-1.0, 0.0, 1.0]))[1, 1]
        is_known = max(row, column) < 1.0 and (row, column) != (0.525, -0.65)
        assert found == pytest.approx(depth if is_known else np.nan, abs=0.03, nan_ok=True)


def test_rotated_grids_are_refused(tmp_path: Path) -> None:
    with h5py.File(write_netcdf(tmp_path / "b.nc", states="s"), "a") as file:
        file["lat"].attrs["standard_name"] = np.bytes_("grid_latitude")
    with pytest.raises(ConfigError, match="rotated pole"):
        open_raster(str(tmp_path / "b.nc"))


def write_tiff(path: Path, crs: str, step: tuple[float, ...], value: Callable[[Array, Array], Array]) -> str:
    where = rasterio.Affine(*step)
    x, y = where @ np.array(np.meshgrid(np.arange(100) + 0.5, np.arange(100) + 0.5))
    shape = {"driver": "GTiff", "width": 100, "height": 100, "count": 1, "dtype": "float32"}
    with rasterio.open(path, "w", crs=crs, transform=where, **shape) as file:
        file.write(value(x, y).astype("f4"), 1)
        file.set_band_description(1, "depth")
    return str(path)


@pytest.mark.parametrize(("crs", "step"), [
    *(("EPSG:32632", step) for step in [
        (-10.0, 0.0, 5e5, 0.0, -10.0, 6e6), (10.0, 0.0, 5e5, 0.0, 10.0, 6e6), (0.0, 10.0, 5e5, -10.0, 0.0, 6e6),
        (8.0, 5.0, 5e5, 5.0, -8.0, 6e6),
    ]),
    ("EPSG:4326", (-0.001, 0.0, 10.1, 0.0, -0.001, 54.1)), ("EPSG:4326", (0.001, 0.0, -180.05, 0.0, -0.001, -16.0)),
    ("EPSG:3413", (200.0, 0.0, -9e3, 0.0, -200.0, 1e4)), ("EPSG:3031", (-200.0, 0.0, 1e4, 0.0, -200.0, 9e3)),
    ("EPSG:3832", (100.0, 0.0, 3.33e6, 0.0, -100.0, 6e6)), ("EPSG:2229", (30.0, 0.0, 6.4e6, 0.0, -30.0, 1.8e6)),
])  # fmt: skip
def test_worlds_of_rasters_in_any_direction_and_at_the_edges_of_maps(
    crs: str, step: tuple[float, ...], tmp_path: Path
) -> None:
    def value(x: Array, y: Array) -> Array:
        return 100.0 + 30.0 * np.sin((x - step[2]) / abs(step[0] + step[1]) / 60.0) + (y - step[5]) / 1e3

    path = write_tiff(tmp_path / "a.tif", crs, step, value)
    if crs == "EPSG:2229":
        with pytest.raises(ConfigError, match="positions are in US survey foot, and nothing states the unit of its de"):
            open_raster(path)
        return
    survey, extent = read_sources([path], None)
    grid = build(survey, extent).model.grid
    latitude, longitude = survey.origin or (0.0, 0.0)
    east, north = (part.ravel() for part in np.meshgrid(grid.east, grid.north))
    local = f"+proj=ortho +lat_0={latitude} +lon_0={longitude} +datum=WGS84"
    x, y = (np.array(part) for part in warp.transform(local, crs, east, north))
    if crs == "EPSG:4326" and step[2] < 0.0:
        x = (x + 360.0) % 360.0 - 360.0
    column, row = ~rasterio.Affine(*step) @ (x, y)
    inside = (np.minimum(column, row) > 1.0) & (np.maximum(column, row) < 99.0)
    assert inside.sum() > 4000
    assert grid.depths.ravel()[inside] == pytest.approx(value(x, y)[inside], abs=0.3)


@pytest.mark.parametrize(("crs", "length"), [("EPSG:2229+6360", 1200.0 / 3937.0), ("EPSG:2229+5703", 1.0)])
def test_the_vertical_axis_states_unit_and_direction(crs: str, length: float, tmp_path: Path) -> None:
    path = write_tiff(tmp_path / "a.tif", crs, (30.0, 0.0, 6.4e6, 0.0, -30.0, 1.8e6), lambda x, y: 0.0 * x + 50.0)
    with rasterio.open(path, "r+") as file:
        file.set_band_description(1, "")
    assert open_raster(path).scale == pytest.approx(-length)


def test_values_of_8_bits_are_asked_about(tmp_path: Path) -> None:
    path = str(tmp_path / "a.tif")
    where = {"crs": "EPSG:32632", "transform": rasterio.Affine(10.0, 0.0, 5e5, 0.0, -10.0, 6e6)}
    with rasterio.open(path, "w", driver="GTiff", width=9, height=9, count=1, dtype="uint8", **where) as file:
        file.write(np.full((1, 9, 9), 90, "u1"))
    with pytest.raises(ConfigError, match="8 bits may be shades of a picture: if they are whole metres, use --unit m"):
        open_raster(path)
    assert open_raster(path, Declared(unit="fathom")).scale == pytest.approx(1.8288)


@pytest.mark.parametrize(("text", "options", "found"), [
    ("x,y,z\n10.01,54.01,5\n10.02,54.02,9\n", {}, "look like degrees: use --crs EPSG:4326"),
    ("x,y,z\n10.01,54.01,5\n10.02,54.02,9\n", {"crs": "EPSG:4326"}, (54.01, 10.01, 5.0)),
    ("x,y,z\n0,0,5\n40,20,9\n", {}, (0.0, 0.0, 5.0)),
    ("east,north,z\n0,0,5\n1,1,9\n", {}, (0.0, 0.0, 5.0)),
    ("37.8 -122.4 5\n37.9 -122.5 9\n", {}, (37.8, -122.4, 5.0)),
    ("54.1 10.1 5\n54.2 10.2 9\n", {}, (10.1, 54.1, 5.0)),
    ("lon,lat,depth_usft\n10,54,10\n", {}, (54.0, 10.0, 12000.0 / 3937.0)),
    ("lon,lat,depth\n10,54,10\n", {"unit": "fathom"}, (54.0, 10.0, 18.288)),
    ("lon,lat,depth,raw\n10,54,10,11\n", {"layer": "raw"}, (54.0, 10.0, 11.0)),
    ("lon,lat,depth,raw_depth\n10,54,10,11\n", {}, (54.0, 10.0, 10.0)),
    ("lon,lat,depth\n10,54,10\n", {"layer": "raw"}, "has the columns lon, lat, depth"),
    ("east,north,depth\n6400000,1800000,10\n", {"crs": "EPSG:2229"}, "nothing states the unit of its depths"),
    ("east,north,depth_m\n0,0,10\n", {"crs": "EPSG:32632"}, (0.0, 4.511256, 10.0)),
])  # fmt: skip
def test_columns_degrees_and_feet_of_texts(
    text: str, options: dict[str, str], found: str | tuple[float, ...], tmp_path: Path
) -> None:
    path = tmp_path / "soundings.csv"
    path.write_text(text)
    if isinstance(found, str):
        with pytest.raises(ConfigError, match=found):
            read_points(str(path), Declared(**options))  # type: ignore[arg-type] # any option
        return
    points = read_points(str(path), Declared(**options))  # type: ignore[arg-type] # any option
    assert ("--layer for raw_depth" in points.note) == ("raw_depth" in text)
    assert (*points.positions[0], points.depths[0]) == pytest.approx(found, abs=1e-6)


def test_point_clouds_become_the_bed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    laspy = pytest.importorskip("laspy", reason="LAS needs laspy: pip install 'uuv-hil[raster]'")
    from laspy.vlrs.known import WktCoordinateSystemVlr

    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [0.001] * 3, [6.4e6, 1.8e6, 0.0]
    cloud = laspy.LasData(header)
    east, north = (part.ravel() for part in np.meshgrid(np.arange(60.0), np.arange(60.0)))
    cloud.x, cloud.y, cloud.z = 6.4e6 + east, 1.8e6 + north, -20.0 - 0.1 * east
    cloud.classification = np.where(north < 50.0, np.where(east < 30.0, 2, 40), 41)
    cloud.withheld = north == 0.0
    for ending, crs, length in (("las", "EPSG:2229+6360", 1200.0 / 3937.0), ("laz", "EPSG:2229+5703", 1.0)):
        cloud.vlrs.clear()
        cloud.vlrs.append(WktCoordinateSystemVlr(rasterio.crs.CRS.from_user_input(crs).to_wkt()))
        cloud.write(path := str(tmp_path / f"a.{ending}"))
        points = read_points(path)
        assert len(points.depths) == 49 * 60
        assert points.depths == pytest.approx(length * (20.0 + 0.1 * (np.arange(49 * 60) % 60)), abs=1e-3)
        assert points.positions[0] == pytest.approx((33.9369, -118.5309), abs=0.01)
    monkeypatch.setattr("hil.charts.sources.las.MAX_POINTS", 500)
    thinned = read_points(path)
    assert 100 < len(thinned.depths) <= 500
    assert 22.6 < thinned.depths.mean() < 22.95, "the highest in each cell"
    assert "of 3600 points" in thinned.note
    cloud.classification = np.full(3600, 41)
    cloud.write(path)
    with pytest.raises(ConfigError, match=r"no point of ground \(2\) or bathymetry \(40\), but of the classes \[41\]"):
        read_points(path)
