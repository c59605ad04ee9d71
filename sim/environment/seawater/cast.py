"""Read a CTD cast: temperature and salinity of the water over depth, in a CSV file.

depth,temperature,salinity
0.5,14.2,30.1
10.0,12.8,31.4

The first line names the columns, in any order; other columns are ignored. Needed are `depth` (m) or `pressure` (dbar,
of the water), and `temperature` (deg C, ITS-90) with `salinity` (practical), or instead of these `sound_speed` (m/s)
with `density` (kg/m³). Units after a name, as in `depth (m)`, are ignored, as are lines that begin with # or %. Density
and speed of sound are computed by TEOS-10 (gsw) and cached, so that a slave's next start does not need that library.
A .cnv of Sea-Bird is read as well, with the names in its header; rows with its `bad_flag` are left out.
"""

import csv
import re
from collections.abc import Iterable
from math import isfinite
from typing import Any, NamedTuple

from hil.common.errors import ConfigError, MissingExtraError
from hil.common.tables import check_file, read_bytes, read_cached, write_cached

Origin = tuple[float, float]  # latitude and longitude, deg

MAX_ROWS = 60  # of a profile: more are averaged, because every sound ray passes all of them
MAX_BYTES = 16 << 20
MAX_ABOVE = 1.0  # m or dbar: sensors on deck and offsets of pressure read a little less than zero
_NAMES = {
    "depth": "depth", "depsm": "depth", "pressure": "pressure", "pres": "pressure", "prdm": "pressure",
    "temperature": "temperature", "temp": "temperature", "t090c": "temperature", "salinity": "salinity",
    "sal": "salinity", "sal00": "salinity", "sound_speed": "sound_speed", "density": "density",
    "tv290c": "temperature", "prde": "pressure", "t068c": "temperature_68",
}  # fmt: skip
_LATITUDE = 45.0  # deg, for a world without an origin: gravity depends on it

Columns = dict[str, list[float]]


class _Water(NamedTuple):
    depth: list[float]
    density: list[float]
    sound_speed: list[float]


def read_cast(path: str, origin: Origin | None) -> dict[str, Any]:
    """Return lists of depth (m), density (kg/m³) and sound_speed (m/s) of the cast in a file, by growing depth.

    `origin` is the latitude and longitude (deg) of the world, which has a small effect on the salinity. Raises
    ConfigError, MissingExtraError.
    """
    stamp = (*check_file(path, MAX_BYTES), origin)
    cached: dict[str, Any] | None = read_cached(f"{path}.profile", stamp)
    if cached is None:
        columns = _thinned(_read(path))
        water = _by_teos10(columns, origin, path) if "temperature" in columns else _given(columns, path)
        cached = water._asdict()
        write_cached(f"{path}.profile", stamp, cached)
    return cached


def _read(path: str) -> Columns:
    """Return the columns with known names. Raises ConfigError."""
    header, rows = _table(path)
    words = [re.split(r"[^a-z0-9_]+", name.strip().lower())[0] for name in header]
    column_of = {_NAMES[word]: k for k, word in enumerate(words) if word in _NAMES}
    if not column_of.keys() & {"depth", "pressure"}:
        raise ConfigError(f"{path}: no column 'depth' (m) or 'pressure' (dbar) among {', '.join(header)}")
    columns: Columns = {name: [] for name in column_of}
    for number, row in enumerate(rows, 2):
        for name, place in column_of.items():
            try:
                value = float(row[place].replace(",", "."))  # a decimal comma, unless commas separate columns
            except (ValueError, IndexError):
                value = float("nan")
            if not isfinite(value):
                raise ConfigError(f"{path}: row {number} has no number for {name}: leave the row out")
            columns[name].append(value)
    if "temperature_68" in columns:
        columns.setdefault("temperature", [value / 1.00024 for value in columns.pop("temperature_68")])
    along = "depth" if "depth" in columns else "pressure"
    if min(columns[along]) < -MAX_ABOVE:
        raise ConfigError(f"{path}: column {along}: {min(columns[along]):g} is above the surface: it counts downwards")
    columns[along] = [max(0.0, value) for value in columns[along]]
    return columns


def _table(path: str) -> tuple[list[str], list[list[str]]]:
    """Return names of columns and rows of a CSV file or a .cnv. Raises ConfigError."""
    data = read_bytes(path, MAX_BYTES)
    if path.lower().endswith(".cnv"):
        return _seabird_table(data.decode("latin-1"), path)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ConfigError(f"{path}: is not UTF-8 text; save it as UTF-8") from None
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith(("#", "%"))]
    if len(lines) < 2:
        raise ConfigError(f"{path}: holds no row: give names of columns and a row for each depth")
    separator = max(",;\t", key=lines[0].count)
    header, *rows = csv.reader(lines, delimiter=separator)
    return header, rows


def _seabird_table(text: str, path: str) -> tuple[list[str], list[list[str]]]:
    """Return names of columns and rows of a .cnv, without rows that have its value for bad data."""
    head, _, body = text.partition("*END*")
    header = [name.strip() for name in re.findall(r"^# name \d+ = ([^:\r\n]+)", head, re.M)]
    bad = re.search(r"^# bad_flag = (\S+)", head, re.M)
    flag = float(bad[1]) if bad else None
    rows = [line.split() for line in body.splitlines() if line.strip()]
    rows = [row for row in rows if flag is None or flag not in [_number(cell) for cell in row[:-1]]]
    if not header or not rows:
        raise ConfigError(f"{path}: no .cnv of Sea-Bird with names of columns and rows: save the cast as CSV")
    return header, rows


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return float("nan")


def _thinned(columns: Columns) -> Columns:
    """Return rows of growing depth; if there are more than MAX_ROWS, the means in MAX_ROWS bins."""
    along = columns.get("depth") or columns["pressure"]
    low, high = min(along), max(along)
    size = (high - low) / MAX_ROWS if len(along) > MAX_ROWS else 0.0
    bins: dict[float, list[int]] = {}
    for k, value in enumerate(along):
        bins.setdefault(min(int((value - low) / size), MAX_ROWS - 1) if size else value, []).append(k)
    groups = [bins[key] for key in sorted(bins)]
    return {name: [sum(values[k] for k in group) / len(group) for group in groups] for name, values in columns.items()}


def _given(columns: Columns, path: str) -> _Water:
    """Return density and speed of sound as the file gives them. Raises ConfigError."""
    missing = [name for name in ("depth", "density", "sound_speed") if name not in columns]
    if missing:
        raise ConfigError(
            f"{path}: no column {', '.join(map(repr, missing))}: give temperature and salinity, or depth, density and "
            "sound_speed"
        )
    return _Water(columns["depth"], columns["density"], columns["sound_speed"])


def _by_teos10(columns: Columns, origin: Origin | None, path: str) -> _Water:
    """Return density and speed of sound of sea water by TEOS-10. Raises ConfigError, MissingExtraError."""
    if "salinity" not in columns:
        raise ConfigError(f"{path}: temperature without a column 'salinity': 0 is fresh water")
    try:
        import gsw
        import numpy as np
    except ImportError:
        raise MissingExtraError(f"{path}: temperature and salinity need gsw: pip install 'uuv-hil[ocean]'") from None
    latitude, longitude = origin or (_LATITUDE, 0.0)
    temperature, practical = np.array(columns["temperature"]), np.array(columns["salinity"])
    if temperature.min() < -3.0 or temperature.max() > 45.0 or practical.min() < 0.0 or practical.max() > 45.0:
        raise ConfigError(
            f"{path}: temperature (deg C) or salinity out of -3 to 45 and 0 to 45: are the columns right?"
        )
    if "depth" in columns:
        depth = np.array(columns["depth"])
        pressure = gsw.p_from_z(-depth, latitude)
    else:
        pressure = np.array(columns["pressure"])
        depth = -gsw.z_from_p(pressure, latitude)
    salinity = gsw.SR_from_SP(practical)
    if origin is not None:
        here = gsw.SA_from_SP(practical, pressure, longitude, latitude)
        salinity = np.where(np.isfinite(here), here, salinity)  # not finite where its atlas has land
    conservative = gsw.CT_from_t(salinity, temperature, pressure)
    return _Water(
        _rounded(depth), _rounded(gsw.rho(salinity, conservative, pressure)),
        _rounded(gsw.sound_speed(salinity, conservative, pressure)),
    )  # fmt: skip


def _rounded(values: Iterable[float]) -> list[float]:
    return [round(float(value), 4) for value in values]
