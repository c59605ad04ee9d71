"""Rasters as hydrographic offices publish them: S-102 with quality or without uncertainty, BAG of several resolutions.

The real ones that these are like: S-102 of NOAA (US4MI1CI) and BSH (DE00NO13R), BAG of the Open Navigation Surface.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hil.charts.build import build
from hil.charts.projection import LocalPlane
from hil.charts.sources.combine import ReadOptions, read_sources
from hil.charts.sources.rasters import open_raster
from hil.charts.sources.sign import Declared
from hil.common.errors import ConfigError

h5py = pytest.importorskip("h5py", reason="reads and writes HDF5: pip install 'uuv-hil[raster]'")
pytest.importorskip("rasterio", reason="rasters need rasterio: pip install 'uuv-hil[raster]'")

SIZE, CELL, FINE = 6, 30.0, 10  # coarse nodes along a side, m between them, fine nodes along one's side
AXES = "".join(
    f"""<gmd:axisDimensionProperties><gmd:MD_Dimension><gmd:dimensionName><gmd:MD_DimensionNameTypeCode
 codeListValue="{name}">{name}</gmd:MD_DimensionNameTypeCode></gmd:dimensionName><gmd:dimensionSize><gco:Integer>6
</gco:Integer></gmd:dimensionSize><gmd:resolution><gco:Measure uom="m">30</gco:Measure></gmd:resolution>
</gmd:MD_Dimension></gmd:axisDimensionProperties>"""
    for name in ("row", "column")
)
METADATA = f"""<gmi:MI_Metadata xmlns:gmi="http://www.isotc211.org/2005/gmi" xmlns:gmd="http://www.isotc211.org/2005/gmd"
 xmlns:gco="http://www.isotc211.org/2005/gco" xmlns:gml="http://www.opengis.net/gml/3.2">
<gmd:spatialRepresentationInfo><gmd:MD_Georectified>{AXES}<gmd:cornerPoints>
<gml:Point gml:id="id1"><gml:coordinates decimal="." cs="," ts=" ">500000,6000000 500150,6000150</gml:coordinates>
</gml:Point></gmd:cornerPoints></gmd:MD_Georectified></gmd:spatialRepresentationInfo></gmi:MI_Metadata>"""


def s102(path: Path, with_uncertainty: bool) -> str:
    """Write 30 x 40 depths as edition 3.0 lays them out: 20 m in the south, 0.3 m a row less to the north, in UTM."""
    members = [("depth", "<f4"), *([("uncertainty", "<f4")] if with_uncertainty else [])]
    grid_attributes = {"gridOriginLongitude": 5e5, "gridOriginLatitude": 6e6, "gridSpacingLongitudinal": 10.0,
             "gridSpacingLatitudinal": 10.0, "numPointsLongitudinal": np.uint32(40),
             "numPointsLatitudinal": np.uint32(30), "numGRP": np.uint8(1), "startSequence": "0,0"}  # fmt: skip
    depths = np.zeros((30, 40), members)
    depths["depth"] = 20.0 - 0.3 * np.arange(30)[:, None]
    depths["depth"][:5, :5] = 1e6
    records = np.array([(1, 0.5)], [("id", "<u4"), ("uncertainty", "<f4")])
    with h5py.File(path, "w") as file:
        file.attrs.update({"productSpecification": "INT.IHO.S-102.3.0.0", "issueDate": "20241211",
                           "horizontalCRS": np.int32(32632), "verticalDatum": np.uint16(12)})  # fmt: skip
        file.create_group("Group_F")
        parts = {"BathymetryCoverage": depths, "QualityOfBathymetryCoverage": np.ones((30, 40), "<u4")}
        for name, values in parts.items():
            instance = file.create_group(f"{name}/{name}.01")
            instance.attrs.update(grid_attributes)
            instance.create_group("Group_001").create_dataset("values", data=values, compression="gzip")
        file["QualityOfBathymetryCoverage/featureAttributeTable"] = records
    return str(path)


@pytest.mark.parametrize("with_uncertainty", [True, False])
def test_s102_of_edition_3_is_read(with_uncertainty: bool, tmp_path: Path) -> None:
    path = s102(tmp_path / "102AA00BAY.H5", with_uncertainty)
    survey, extent = read_sources([path], None)
    grid = build(survey, extent).model.grid
    assert survey.beds[0][0] == "102AA00BAY.H5"
    assert not survey.notes
    found = grid.at(np.column_stack(_local(survey.origin, [500200.0, 500200.0, 500010.0], [6000100.0, 6000200.0, 6e6])))
    assert found[:2] == pytest.approx([17.0, 14.0], abs=0.05)
    assert np.isnan(found[2])


def test_other_s100_products_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "111AA00BAY.h5"
    with h5py.File(path, "w") as file:
        file.attrs["productSpecification"] = "INT.IHO.S-111.1.0"
        file.create_group("SurfaceCurrent")
    with pytest.raises(ConfigError, match=r"111AA00BAY\.h5: cannot be read as a raster"):
        open_raster(str(path))


def varying_bag(path: Path) -> str:
    """Write a BAG of variable resolution whose depth is 20 m, 0.1 m more for each m to the east: 3 m apart."""
    step = CELL / FINE
    east = np.arange(SIZE)[:, None] * CELL - 0.5 * CELL + step * (0.5 + np.arange(FINE))
    fine = np.repeat(east[None, :, None, :], FINE, axis=2)  # (1, coarse, rows, columns)
    heights = -20.0 - 0.1 * np.broadcast_to(fine, (SIZE, SIZE, FINE, FINE)).reshape(SIZE, SIZE, FINE * FINE)
    table = np.zeros((SIZE, SIZE), [(name, "<u4") for name in ("index", "dimensions_x", "dimensions_y")] + [
        (name, "<f4") for name in ("resolution_x", "resolution_y", "sw_corner_x", "sw_corner_y")])  # fmt: skip
    table["index"] = FINE * FINE * np.arange(SIZE * SIZE).reshape(SIZE, SIZE)
    table["dimensions_x"] = table["dimensions_y"] = FINE
    for name, value in (("resolution", step), ("sw_corner", 0.5 * step)):
        table[f"{name}_x"] = table[f"{name}_y"] = value
    refined = np.zeros((1, heights.size), [("depth", "<f4"), ("depth_uncrt", "<f4")])
    refined["depth"] = heights.ravel()
    coarse = np.full((SIZE, SIZE), -99.0, "<f4")
    layers: dict[str, tuple[Any, dict[str, float]]] = {
        "elevation": (coarse, {"Minimum Elevation Value": -99.0, "Maximum Elevation Value": -99.0}),
        "uncertainty": (coarse, {"Minimum Uncertainty Value": 0.0, "Maximum Uncertainty Value": 0.0}),
        "varres_metadata": (table, {f"{end}_resolution_{axis}": step for end in ("min", "max") for axis in "xy"}),
        "varres_refinements": (refined, {"min_depth": -99.0, "max_depth": 0.0}),
        "metadata": (np.frombuffer(METADATA.encode(), "S1"), {}),
    }
    with h5py.File(path, "w") as file:
        root = file.create_group("BAG_root")
        root.attrs["Bag Version"] = np.bytes_("1.6.2")
        for name, (values, attributes) in layers.items():
            root[name] = values
            root[name].attrs.update({key: np.float32(value) for key, value in attributes.items()})
    return str(path)


def test_a_bag_of_variable_resolution_is_read_at_its_finest_resolution(tmp_path: Path) -> None:
    """The overview, which has one node in 30 m and here another depth, is not read."""
    path = varying_bag(tmp_path / "vr.bag")
    with pytest.raises(ConfigError, match="name it, for example --crs"):
        open_raster(path)
    survey, extent = read_sources([path], None, options=ReadOptions(Declared(crs="EPSG:32632")))
    grid = build(survey, extent).model.grid
    assert grid.resolution == pytest.approx(3.0, abs=0.2)
    east = np.array([500030.0, 500085.0, 500120.0])
    places = np.column_stack(_local(survey.origin, east, np.full(3, 6000075.0)))
    assert grid.at(places) == pytest.approx(20.0 + 0.1 * (east - 500000.0), abs=0.2)


def _local(origin: tuple[float, float] | None, east: Any, north: Any) -> tuple[Any, Any]:
    from rasterio.warp import transform

    longitude, latitude = transform("EPSG:32632", "EPSG:4326", east, north)
    return LocalPlane(*origin or (0.0, 0.0)).to_local(np.array(latitude), np.array(longitude))
