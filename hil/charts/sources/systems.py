"""Read coordinate systems: by name, their vertical axis, and what their horizontal unit implies for depths."""

import re
from typing import Any

from hil.charts.sources.sign import UNITS, metres_per_unit
from hil.common.errors import ConfigError, MissingExtraError
from hil.common.text import clean

WGS84 = "EPSG:4326"


def parse_crs(name: str) -> Any:
    """Return the coordinate system with the name that the user gave. Raises ConfigError for an unknown one."""
    try:
        import rasterio
        from rasterio.crs import CRS
        from rasterio.errors import CRSError
    except ImportError:
        raise MissingExtraError("coordinate systems need rasterio: pip install 'uuv-hil[raster]'") from None
    try:
        with rasterio.Env():  # else PROJ prints a line of its own
            return CRS.from_user_input(name)
    except CRSError as error:
        raise ConfigError(
            f"--crs: {clean(name, 60)}: unknown coordinate system ({error}); use for example EPSG:32605"
        ) from None


def vertical_axis(crs: Any) -> tuple[str, str]:
    """Return the unit of the vertical axis of a rasterio CRS, and "height" or "depth"; "" for what it has not."""
    text = crs.to_wkt() if crs else ""
    vertical = text[text.find("VERT") :] if "VERT" in text else ""
    unit = re.search(r'UNIT\["([^"]*)"', vertical)
    axis = re.search(r",\s*(up|down)\b", vertical, re.IGNORECASE)
    return unit[1] if unit else "", {"up": "height", "down": "depth"}[axis[1].lower()] if axis else ""


def depth_unit(path: str, stated: str, declared: str | None, crs: Any) -> tuple[float, str]:
    """Return the length in m of the unit of the depths in a file, and a note on what was assumed, "" for nothing.

    `stated`: the unit in the file, "" if it has none; `declared`: that of the user, which comes first; `crs`: the
    coordinate system of the positions, None if there is none. Raises ConfigError for an unknown unit, and if positions
    are in feet and nothing states the unit of depths.
    """
    stated = stated or vertical_axis(crs)[0]
    if declared:
        differs = stated and UNITS.get(stated.strip().lower()) != UNITS[declared]
        return UNITS[declared], f"{path}: states depths in {stated}; --unit {declared} is used" if differs else ""
    if stated:
        return metres_per_unit(path, stated), ""
    if not crs or not crs.is_projected:
        return 1.0, ""
    name, title = crs.linear_units_factor[0], crs.to_wkt().split('"')[1]
    if "foot" in name.lower() or "feet" in name.lower():
        raise ConfigError(
            f"{path}: its positions are in {name}, and nothing states the unit of its depths: use --unit us-ft, "
            "--unit ft or --unit m"
        )
    is_state_plane = title.startswith("NAD") and "UTM" not in title and "zone" in title.lower()
    note = f"{path}: depths read as metres, as its positions in {title} (else use --unit)"
    return 1.0, note if is_state_plane else ""
