"""Read one S-57 chart with GDAL; `hil.charts.sources.s57` calls it in a separate process, within limits."""

import os
import tempfile
import warnings
from collections import Counter
from typing import Any

from hil.common.errors import ConfigError, MissingExtraError
from hil.common.tables import read_table
from hil.common.text import clean

OBJECTS: dict[str, dict[str, Any]]  # the object classes that are read, and what they are in a world
OBJECTS, RULES = read_table(os.path.join(os.path.dirname(__file__), "objects.toml")).values()
NAME = "OBJNAM"
SHOWN_FROM = "SCAMIN"  # denominator of the smallest scale at which a display shows the object
LISTS = ("NATSUR", "RESTRN")  # attributes that are lists of numbers
ATTRIBUTES = ("BURDEP", "CATCOV", "CATMOR", "CATSLC", "DRVAL1", "DRVAL2", "VALDCO", "VALSOU", "VERCLR", "WATLEV")
POINT, MULTI_POINT, AREA = 0, 4, 3  # shapely's type numbers, and S-57's code of an area (PRIM)
Row = tuple[Any, ...]  # the fields of a hil.charts.sources.s57.Feature
REMEDY = "get the right file, or use --no-updates to read the cell as issued"
DOES_NOT_FIT = "does not fit the cell: it is of another edition, is damaged, or withdraws the chart"
UNFIT = ("Mismatched RVER", "Can't find RCNM")  # GDAL's warnings if an update refers to a record that does not exist


def read_chart(path: str, updates: bool) -> dict[str, Any]:
    """Return the contents of the chart at `path`, with the updates beside it or without.

    Raises ConfigError, MissingExtraError.
    """
    warnings.simplefilter("ignore")  # GDAL tolerates small defects of a chart and warns of them
    try:
        import pyogrio  # noqa: F401 - to check that it is installed
        import shapely  # noqa: F401
    except ImportError:
        raise MissingExtraError("charts need GDAL: pip install 'uuv-hil[chart]'") from None
    _set_options("IGNORE")
    try:
        return _read_updated(path) if updates else _read(path)
    except MemoryError:
        raise
    except Exception as error:  # noqa: BLE001 - GDAL and GEOS raise any error on a damaged chart
        reason = clean((str(error).strip().splitlines() or [type(error).__name__])[-1].strip())
        if isinstance(error, _UpdateError):
            raise ConfigError(f"{path}: an update beside it {DOES_NOT_FIT} ({reason}): {REMEDY}") from None
        raise ConfigError(f"{path}: damaged or cut off ({reason}); copy it again") from None


class _UpdateError(RuntimeError):
    """Error of an update that cannot be applied to its cell."""


def _read_updated(path: str) -> dict[str, Any]:
    """Return the cell with its updates. Raises _UpdateError, and GDAL's errors."""
    dataset = _dataset(path)
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        cell = _link_updates(path, str(dataset["DSID_EDTN"]), _update_of(dataset), folder)
        _set_options("APPLY")
        try:
            contents = _read(cell)
        except Exception as error:  # noqa: BLE001 - as in read_chart
            kind = _UpdateError if len(os.listdir(folder)) > 1 else RuntimeError  # without updates, the cell's own
            raise kind(str(error).replace(cell, path)) from None
    for warning in caught:
        if str(warning.message).startswith(UNFIT):
            raise _UpdateError(str(warning.message))
    return contents


def _set_options(updates: str) -> None:
    import pyogrio

    options = f"RETURN_PRIMITIVES=OFF,RETURN_LINKAGES=OFF,LNAM_REFS=OFF,SPLIT_MULTIPOINT=OFF,UPDATES={updates}"
    pyogrio.set_gdal_config_options({"OGR_S57_OPTIONS": options})


def _link_updates(path: str, edition: str, update: int, folder: str) -> str:
    """Create links in `folder` to the cell and to its updates after number `update`; return the link to the cell.

    GDAL applies updates from 001 on, so the links are numbered from there. Raises _UpdateError for an update of another
    edition, which GDAL would apply.
    """
    stem = os.path.abspath(path)[:-4]
    os.symlink(stem + path[-4:], cell := os.path.join(folder, "CELL.000"))
    for number in range(1, 1000 - update):
        source = f"{stem}.{update + number:03d}"
        if not os.path.exists(source):
            break
        try:
            dataset = _dataset(source)
        except Exception as error:  # noqa: BLE001 - as in read_chart
            raise _UpdateError(str(error)) from None
        if (str(dataset["DSID_EDTN"]), _update_of(dataset)) != (edition, update + number):
            found = f"{source} is update {dataset['DSID_UPDN']} of edition {dataset['DSID_EDTN']}"
            raise _UpdateError(f"{found}, not {update + number} of {edition}")
        os.symlink(source, os.path.join(folder, f"CELL.{number:03d}"))
    return cell


def _dataset(path: str) -> dict[str, Any]:
    """Return the fields of layer DSID, which describes the file."""
    from pyogrio import raw

    meta, _, _, columns = raw.read(path, layer="DSID")
    return {name: column[0] for name, column in zip(meta["fields"], columns, strict=True)}


def _update_of(dataset: dict[str, Any]) -> int:
    return int(dataset["DSID_UPDN"] or 0)


def _read(path: str) -> dict[str, Any]:
    import pyogrio

    layers = {str(name) for name, _ in pyogrio.list_layers(path)}
    dataset = _dataset(path)
    features: list[Row] = []
    shown: Counter[int] = Counter()
    unclosed = {kind: _read_layer(path, kind, features, shown) for kind in OBJECTS if kind in layers}
    return {
        "edition": int(dataset["DSID_EDTN"]),
        "update": _update_of(dataset),
        "scale": int(dataset["DSPM_CSCL"]),
        "purpose": int(dataset["DSID_INTU"]),
        "shown": sorted(shown.items()),
        "units": [int(dataset["DSPM_DUNI"]), int(dataset["DSPM_COUN"])],
        "factors": [int(dataset["DSPM_COMF"]), int(dataset["DSPM_SOMF"])],
        "unclosed": {kind: count for kind, count in unclosed.items() if count},
        "features": features,
    }


def _read_layer(path: str, kind: str, features: list[Row], shown: Counter[int]) -> int:
    """Append the objects of a class to `features`, and count in `shown` their SHOWN_FROM.

    Return the number of areas with edges that form no ring. Each chain of their edges is closed by a straight line.
    Areas are filled by counting crossings, so the straight lines between the same two ends cancel each other.
    """
    import numpy as np
    import shapely
    from pyogrio import raw

    meta, _, wkb, columns = raw.read(path, layer=kind, columns=["PRIM", NAME, SHOWN_FROM, *LISTS, *ATTRIBUTES])
    fields = dict(zip(meta["fields"], columns, strict=True))
    scales = np.asarray(fields.get(SHOWN_FROM, ()), float)
    shown.update(map(int, scales[scales > 0.0]))
    unclosed = 0
    try:
        shapes = shapely.from_wkb(wkb)
    except shapely.errors.GEOSException:
        unclosed = int(shapely.is_missing(shapely.from_wkb(wkb, on_invalid="ignore")).sum())
        shapes = shapely.from_wkb(wkb, on_invalid="fix")
        unclosed -= int(shapely.is_missing(shapes).sum())
    for number, shape in enumerate(shapes):
        numbers = {name: float(fields[name][number]) for name in ATTRIBUTES if name in fields}
        points, lines = np.empty((0, 3)), []
        if shape is not None and shapely.get_type_id(shape) in (POINT, MULTI_POINT):
            points = shapely.get_coordinates(shape, include_z=True)
        elif shape is not None:
            parts = shapely.get_parts(shape)
            is_area = shapely.get_dimensions(shape) == 2
            lines = [shapely.get_coordinates(part) for part in (shapely.get_rings(parts) if is_area else parts)]
        attributes = {name: value for name, value in numbers.items() if value == value}
        codes = {name: _numbers(fields[name][number]) for name in LISTS if name in fields}
        own_name = clean(str((fields[NAME][number] if NAME in fields else None) or ""))
        features.append((kind, attributes, points, tuple(lines), int(fields["PRIM"][number]) == AREA, codes, own_name))
    return unclosed


def _numbers(value: Any) -> list[int]:
    """Return the numbers of a list attribute, which GDAL returns as text; an empty list if it is missing."""
    items = [] if value is None else [value] if isinstance(value, str) else list(value)
    return [int(item) for item in items if str(item).strip().isdigit()]
