"""Find the depths in a NetCDF file and their axes, by the CF conventions, and lay them out as rasters are.

GDAL takes the last two dimensions as north and east, and their steps as even. Where a file says otherwise, its values
are laid out again in memory.
"""

import re
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.charts.sources.sign import UNITS, Declared, is_depth_name, join_notes
from hil.charts.sources.systems import WGS84
from hil.common.errors import ConfigError, MissingExtraError

Array = NDArray[np.float64]

MAX_VALUES = 100_000_000  # of a layer that is laid out again, 4 bytes each
UNEVEN = 0.02  # share of a step by which positions of an even axis may be off
MAX_FINER = 8.0  # even steps for one uneven one, on average
# What says that a variable is an axis, from the strongest: an attribute or its name, and its words for north and east
AXES = (
    ("standard_name", r"latitude|projection_y_coordinate|grid_latitude",
     r"longitude|projection_x_coordinate|grid_longitude"),
    ("units", r"degrees?_?n(orth)?", r"degrees?_?e(ast)?"),
    ("axis", "y", "x"),
    ("name", r"lat(itude)?s?|y|yc|north(ing)?", r"lon(gitude)?s?|lng|long|x|xc|east(ing)?"),
)  # fmt: skip


class Variable(NamedTuple):
    """A variable of a NetCDF file; `data` is read where it is indexed."""

    name: str
    dimensions: tuple[str, ...]
    attributes: Mapping[str, Any]
    data: Any

    def text(self, key: str) -> str:
        """Return an attribute as text, "" if there is none."""
        return str(self.attributes.get(key, "")).strip()


class Layer(NamedTuple):
    """A layer of depths: its `variable`, the axes of its columns and rows, and which of several times it is.

    - `place`: index of each dimension, a slice for those of the axes.
    - `is_transposed`: whether `east` comes before `north`.
    - `band`: the number that GDAL gives the layer, 0 if GDAL does not read it as it is meant.
    """

    variable: Variable
    east: Variable
    north: Variable
    place: tuple[int | slice, ...]
    is_transposed: bool
    band: int
    note: str

    def is_geographic(self, is_projected: bool) -> bool:
        """Return whether the axes are longitude and latitude: they say so, or they fit and nothing else is known."""
        words = self.north.text("standard_name"), self.north.text("units").partition("_")[0]
        if is_projected or {"latitude", "degrees", "degree"} & set(words):
            return bool({"latitude", "degrees", "degree"} & set(words))
        return bool(np.abs(self.north.data[:]).max() <= 90.0 and np.abs(self.east.data[:]).max() <= 360.0)


class Axis(NamedTuple):
    """Increasing positions `at`, their indices in the file, and the `even` ones to which values are interpolated."""

    at: Array
    order: Any
    even: Array


@contextmanager
def open_netcdf(path: str) -> Iterator[dict[str, Variable]]:
    """Give the variables of a NetCDF file by name, of the classic format or HDF5; none of another format.

    Raises ConfigError, MissingExtraError.
    """
    with open(path, "rb") as file:
        magic = file.read(4)
    try:
        if magic == b"CDF\5":  # of 64 bits, which neither library knows
            yield {}
        elif magic[:3] == b"CDF":
            from scipy.io import netcdf_file

            with warnings.catch_warnings(), netcdf_file(path, mmap=True, maskandscale=False) as dataset:
                warnings.simplefilter("ignore", RuntimeWarning)  # of arrays that are still in use when it closes
                yield {
                    name: Variable(name, part.dimensions, _texts(part._attributes), part.data)
                    for name, part in dataset.variables.items()
                }
        else:
            import h5py

            with h5py.File(path) as dataset:
                found: dict[str, Variable] = {}
                dataset.visititems(lambda name, part: found.update(_of_hdf5(name, part)))
                yield found
    except ImportError:
        raise MissingExtraError(f"{path}: NetCDF needs scipy and h5py: pip install 'uuv-hil[chart,raster]'") from None
    except (OSError, ValueError, TypeError, LookupError, RuntimeError, AssertionError) as error:
        raise ConfigError(f"{path}: cannot be read as NetCDF: {error}") from None


def _of_hdf5(name: str, part: Any) -> dict[str, Variable]:
    if not hasattr(part, "shape") or part.dtype.kind not in "iuf":
        return {}
    scales = [[scale.name.lstrip("/") for scale in dimension.values()] for dimension in part.dims]
    names = [own[0] if own else f"{name} {number}" for number, own in enumerate(scales)]
    if part.is_scale and part.ndim == 1:
        names = [name]
    attributes = {key: value for key, value in part.attrs.items() if key not in ("DIMENSION_LIST", "REFERENCE_LIST")}
    return {name: Variable(name, tuple(names), _texts(attributes), part)}


def _texts(attributes: Mapping[str, Any]) -> dict[str, Any]:
    """Return attributes with texts instead of bytes, and arrays of one element as that element."""
    plain = {key: value[0] if np.ndim(value) and len(value) == 1 else value for key, value in attributes.items()}
    return {k: v.decode("utf-8", "replace") if isinstance(v, bytes) else v for k, v in plain.items()}


def find_layer(path: str, variables: Mapping[str, Variable], declared: Declared) -> Layer | None:
    """Return the layer of depths that the user or the names choose; None if no variable has axes that are known.

    Raises ConfigError if the file leaves open which it is, and for positions that are no raster's.
    """
    wanted = declared.split_layer()[0]
    numeric = {name: _axes(part, variables) for name, part in variables.items() if part.data.dtype.kind in "iuf"}
    curved = {name: _curved_axes(variables[name], axes, variables) for name, axes in numeric.items()}
    placed = {name: curved[name] or axes for name, axes in numeric.items() if curved[name] or len(axes) == 2}
    if not placed or wanted not in ("", *placed):
        if wanted:
            raise ConfigError(f"--layer {wanted}: {path} has {', '.join(placed) or 'no layer with known axes'}")
        return None
    named = [name for name in placed if is_depth_name(name)] or [
        name for name in placed if any(is_depth_name(variables[name].text(k)) for k in ("standard_name", "long_name"))
    ]
    if not (wanted or named or len(placed) == 1):
        raise ConfigError(f"{path}: has {', '.join(placed)}, none named as depth or elevation: choose one by --layer")
    name = wanted or min(named or placed, key=lambda name: len(re.split("[^a-z]+", name.lower())))
    others = [other for other in named if other != name and not wanted]
    note = f"{path}: {name} is used (--layer for {', '.join(others)})" if others else ""
    return _at_one_time(path, variables, variables[name], placed[name], declared.split_layer()[1], note)


def _axes(variable: Variable, variables: Mapping[str, Variable]) -> dict[str, tuple[int, Variable]]:
    """Return the dimension and the coordinates of "north" and "east" of a variable, as far as it has them."""
    own, found = variable.text("coordinates").split(), dict[str, tuple[int, Variable]]()
    for rule in AXES:
        for number, dimension in enumerate(variable.dimensions):
            along = [v for v in variables.values() if v.dimensions == (dimension,) and len(variable.dimensions) > 1]
            for axis in sorted(along, key=lambda v: (v.name != dimension, v.name.rpartition("/")[2] not in own)):
                kind = _kind(axis, rule)
                if kind and kind not in found and number not in [taken for taken, _ in found.values()]:
                    found[kind] = number, axis
    return found


def _curved_axes(
    variable: Variable, axes: Mapping[str, tuple[int, Variable]], variables: Mapping[str, Variable]
) -> dict[str, tuple[int, Variable]]:
    """Return the coordinates of two dimensions of a variable, unless its axes are positions on the earth; else {}."""
    said = [axis.text("standard_name") + axis.text("units") for _, axis in axes.values()]
    if len(said) == 2 and all(re.match("latitude|longitude|projection|degrees?_", word) for word in said):
        return {}
    flat = [own for own in variables.values() if len(own.dimensions) == 2 and own.name != variable.name]
    inside = [own for own in flat if set(own.dimensions) <= set(variable.dimensions)]
    kinds = {_kind(own, rule): own for rule in reversed(AXES) for own in reversed(inside)}
    if not {"north", "east"} <= set(kinds) or kinds["north"].dimensions != kinds["east"].dimensions:
        return {}
    places = zip(("north", "east"), kinds["north"].dimensions, strict=True)
    return {kind: (variable.dimensions.index(dimension), kinds[kind]) for kind, dimension in places}


def _kind(variable: Variable, rule: tuple[str, str, str]) -> str:
    """Return "north" or "east" of what a rule of AXES takes for such coordinates, else ""."""
    word = (variable.name.rpartition("/")[2] if rule[0] == "name" else variable.text(rule[0])).lower()
    return "north" if re.fullmatch(rule[1], word) else "east" if re.fullmatch(rule[2], word) else ""


def _at_one_time(
    path: str, variables: Mapping[str, Variable], variable: Variable, axes: dict[str, Any], wanted: int, note: str
) -> Layer:
    """Return the layer of a variable with axes: of several times, or of what else, the one `wanted`, from 1."""
    (row, north), (column, east) = axes["north"], axes["east"]
    if "grid_latitude" in north.text("standard_name"):
        raise ConfigError(f"{path}: is a grid about a rotated pole: warp it to longitude and latitude")
    others = [number for number in range(len(variable.dimensions)) if number not in (row, column)]
    sizes = [variable.data.shape[number] for number in others]
    count = int(np.prod(sizes, dtype=int))
    band = wanted or 1
    if band > count:
        raise ConfigError(f"--layer :{band}: {variable.name} of {path} has {count}")
    at = dict(zip(others, np.unravel_index(band - 1, sizes) if sizes else (), strict=True))
    if count > 1 and not wanted:
        names = [variable.dimensions[number] for number in others]
        values = ", ".join(_value(variables.get(name), int(at[k])) for name, k in zip(names, others, strict=True))
        several = f"{path}: {variable.name} has {count} layers along {', '.join(names)}: the first is used, {values}"
        note = join_notes(note, f"{several} (--layer {variable.name}:2 for the next)")
    place = tuple(int(at[k]) if k in at else slice(None) for k in range(len(variable.dimensions)))
    is_last = others == [*range(len(others))]
    return Layer(variable, east, north, place, column < row, band if is_last and row < column else 0, note)


def _value(axis: Variable | None, number: int) -> str:
    """Return the position on an axis as text, a time as date and time."""
    if axis is None:
        return f"number {number + 1}"
    value, units = axis.data[number], axis.text("units")
    unit, _, since = units.partition(" since ")
    seconds = {"da": 86400.0, "ho": 3600.0, "mi": 60.0, "se": 1.0}.get(unit.strip()[:2].lower())
    if since and seconds:
        with suppress(ValueError):
            start = np.datetime64(re.sub(r"(Z| ?\+00:?00| UTC|\.0*)+$", "", since.strip()), "s")
            return str(start + np.timedelta64(round(seconds * float(value)), "s"))
    return f"{axis.name} {value:g} {units}".strip()


def find_axes(path: str, layer: Layer, metres: float) -> tuple[Axis, Axis]:
    """Return the axes of a layer to the east and to the south; `metres`: unit of its positions, 0 for degrees.

    Raises ConfigError for positions that are unknown.
    """
    found = []
    for variable, sign in ((layer.east, 1.0), (layer.north, -1.0)):
        at = sign * _positions(variable, metres)
        if len(at) < 2 or not np.isfinite(at).all():
            raise ConfigError(f"{path}: {variable.name} needs two or more positions, all of them known")
        at, order = np.unique(np.unwrap(at, period=360.0) if sign > 0.0 and not metres else at, return_index=True)
        found.append(Axis(at, order, _even(at, variable.data.dtype)))
    return found[0], found[1]


def read_curved(path: str, layer: Layer) -> tuple[NDArray[np.float32], Any, Any]:
    """Return the values of a layer with positions of two dimensions at even ones, their transform and their system.

    The even ones are in m around the middle of the layer, so that it may lie over a pole. Interpolated by GDAL; what
    has no value has none after it. Raises ConfigError.
    """
    import rasterio
    from rasterio.warp import Resampling, reproject, transform

    values, latitude, longitude = _values(layer), _positions(layer.north, 0.0), _positions(layer.east, 0.0)
    known = np.isfinite(latitude) & np.isfinite(longitude)
    if min(known.shape) < 2 or known.sum() < 4 or np.abs(latitude[known]).max() > 90.0:
        raise ConfigError(f"{path}: its positions of two dimensions are not latitudes and longitudes: warp it to them")
    across, up = np.radians(longitude[known]), np.radians(latitude[known])
    x, y, z = (part.mean() for part in (np.cos(up) * np.cos(across), np.cos(up) * np.sin(across), np.sin(up)))
    middle = np.degrees(np.arctan2([z, y], [np.hypot(x, y), x])).tolist()
    crs = rasterio.crs.CRS.from_string(f"+proj=aeqd +lat_0={middle[0]!r} +lon_0={middle[1]!r} +datum=WGS84 +units=m")
    at = np.full((2, *known.shape), np.nan)
    at[:, known] = transform(rasterio.crs.CRS.from_string(WGS84), crs, longitude[known], latitude[known])
    step = min(float(np.nanmedian(np.hypot(*np.diff(at, axis=axis)))) for axis in (1, 2))
    west, south, east, north = (float(end(part)) for end in (np.nanmin, np.nanmax) for part in at)
    if not step > 0.0 or (east - west) * (north - south) > MAX_VALUES * step**2:
        raise ConfigError(f"{path}: its curved grid has more than {MAX_VALUES} even positions: cut out a part of it")
    for axis in (1, 2):  # GDAL takes the positions as those of the corners of pixels
        before, after = (np.take(at, range(k, k + at.shape[axis] - 1), axis) for k in (0, 1))
        first = 1.5 * before.take([0], axis) - 0.5 * after.take([0], axis)
        at = np.concatenate([first, 0.5 * (before + after)], axis)
    where = rasterio.Affine(step, 0.0, west - 0.5 * step, 0.0, -step, north + 0.5 * step)
    even = np.full((int((north - south) / step) + 2, int((east - west) / step) + 2), np.nan, np.float32)
    reproject(
        values, even, src_geoloc_array=at, src_crs=crs, dst_crs=crs, dst_transform=where, src_nodata=np.nan,
        dst_nodata=np.nan, resampling=Resampling.bilinear,
    )  # fmt: skip
    return even, where, crs


def _positions(axis: Variable, metres: float) -> Array:
    """Return the positions on an axis; `metres`: length of the unit in which they are asked for, 0 for degrees."""
    unit = UNITS.get(axis.text("units").lower(), metres) / metres if metres else 1.0
    return unit * _decode(axis, np.asarray(axis.data[:])).astype(float)


def _even(axis: Array, kind: Any) -> Array:
    """Return even positions from the first to the last of an increasing axis, at its finest step if it is uneven."""
    even = np.linspace(axis[0], axis[-1], len(axis))
    rounding = 2.0 * float(np.finfo(kind).eps) * float(np.abs(axis).max()) if kind.kind == "f" else 0.0
    if np.abs(axis - even).max() <= UNEVEN * (even[1] - even[0]) + rounding:
        return even
    count = min(np.ptp(axis) / np.diff(axis).min(), MAX_FINER * len(axis))
    return np.linspace(axis[0], axis[-1], int(np.ceil(count)) + 1)


def read_layer(path: str, layer: Layer, east: Axis, south: Axis) -> NDArray[np.float32]:
    """Return the values of a layer at even positions, nan where there are none. Raises ConfigError for too many."""
    if max(len(east.even) * len(south.even), len(east.at) * len(south.at)) > MAX_VALUES:
        raise ConfigError(
            f"{path}: {layer.variable.name} has more than {MAX_VALUES} values, in an order that needs all of them in "
            "memory: cut out a part"
        )
    values = _values(layer)[np.ix_(south.order, east.order)]
    return np.asarray(_between(_between(values, south).T, east).T)


def _values(layer: Layer) -> NDArray[np.float32]:
    raw = _decode(layer.variable, np.asarray(layer.variable.data[layer.place])).astype(np.float32)
    return np.asarray(raw.T if layer.is_transposed else raw)


def _decode(variable: Variable, raw: NDArray[Any]) -> NDArray[np.floating[Any]]:
    """Return the values that stored ones mean, nan for those that mean none."""
    attributes = variable.attributes
    if variable.text("_Unsigned").lower() == "true":
        raw = raw.view(raw.dtype.str.replace("i", "u"))
    lowest, highest = attributes.get("valid_range", (-np.inf, np.inf))
    unknown = (raw < attributes.get("valid_min", lowest)) | (raw > attributes.get("valid_max", highest))
    for key in ("_FillValue", "missing_value"):
        if key in attributes:
            unknown |= np.isin(raw, np.asarray(attributes[key]).astype(raw.dtype))
    values = raw * float(attributes.get("scale_factor", 1.0)) + float(attributes.get("add_offset", 0.0))
    return np.asarray(np.where(unknown, np.nan, values))


def _between(values: NDArray[np.float32], axis: Axis) -> NDArray[np.float32]:
    """Return rows that lie at the positions of an axis, interpolated to its even positions."""
    at, even = axis.at, axis.even
    if len(at) == len(even):
        return values
    below = np.clip(np.searchsorted(at, even, "right") - 1, 0, len(at) - 2)
    share = ((even - at[below]) / (at[below + 1] - at[below])).astype(np.float32)[:, None]
    return np.asarray(np.where(share == 0.0, values[below], (1.0 - share) * values[below] + share * values[below + 1]))
