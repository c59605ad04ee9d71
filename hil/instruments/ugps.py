"""Water Linked Underwater GPS G2: the topside computer, which tells by HTTP where the vehicle's locator is.

Positions are in the acoustic frame: x ahead of the topside's housing, y to its right, z the depth below the surface.
With the locator A1 the depth comes from the client, and there is no position without it. Source: docs.waterlinked.com
(reference frames, warnings, levels of signal and noise).
"""

import json
from collections.abc import Mapping
from math import atan2, cos, degrees, dist, hypot, log10, radians, sin, sqrt
from typing import Annotated, Any, NamedTuple

from hil.client.client import Stamped
from hil.common.clock import NS_PER_S
from hil.common.errors import ConfigError
from hil.common.schema import Range
from hil.common.vectors import Vector3
from hil.instruments.contract import Instrument, Response
from hil.instruments.layout import fits, read_device
from sim.geodesy import TangentPlane
from sim.sensors.extra_samples import PositionSample

_DEPTH_NS = 10 * NS_PER_S  # after which an external depth is too old; our choice
_NOISE = -100.0  # dBm
_LEVEL_AT_1M = -75.5  # dBm; 6 dB less for each doubling of distance, and -125 dBm, the weakest that works, at 300 m
_ACCELERATION, _FORGET_S = 0.3, 60.0  # m/s² of the vehicle in the filter, and when that begins again; our choice
_MANY = "; type=collection"
_OF_MANY = "/poi", "/config/receivers"


class UgpsSettings(NamedTuple):
    """Heading of the housing (rad), channel and battery (%) of the locator, temperatures (°C), and the version."""

    heading: Annotated[float, Range(-7.0, 7.0, "rad")] = 0.0
    channel: Annotated[int, Range(0, 6000)] = 3
    battery: Annotated[int, Range(-1, 100)] = 90
    board_temperature: Annotated[float, Range(-40.0, 100.0, "°C")] = 37.0
    water_temperature: Annotated[float, Range(-2.0, 40.0, "°C")] = 10.0
    version: str = "3.3.2"


class Track:
    """A filter of one coordinate and its rate: the steady state of a Kalman filter for constant velocity.

    Its gains follow from the tracking index (Kalata 1984, IEEE AES-20(2)).
    """

    def __init__(self) -> None:
        self.value: float | None = None
        self._rate, self._time_ns = 0.0, 0

    def update(self, measured: float, deviation: float, time_ns: int) -> None:
        """Take a measurement (m) with its standard deviation."""
        seconds, self._time_ns = (time_ns - self._time_ns) * 1e-9, time_ns
        if self.value is None or not 0.0 < seconds < _FORGET_S:
            self.value, self._rate = measured, 0.0
            return
        index = _ACCELERATION * seconds * seconds / deviation
        rest = 0.25 * (4.0 + index - sqrt(8.0 * index + index * index))
        alpha = 1.0 - rest * rest
        predicted = self.value + self._rate * seconds
        self.value = predicted + alpha * (measured - predicted)
        self._rate += (2.0 * (2.0 - alpha) - 4.0 * rest) / seconds * (measured - predicted)


class Ugps(Instrument):
    """A UGPS G2: its antenna is the station of a simulated USBL, its locator the beacon.

    Positions come at the sensor's rate; the device has 4 Hz. 404 without an acoustic position, 503 without one on the
    earth, which needs a world with an `origin`, a static or an external position. Speed of sound, area of search,
    channel and antenna of its settings change what is found. What is not simulated: drift of the compass, echoes.
    """

    Model = UgpsSettings
    sensors = ("usbl",)
    at = ("http:127.0.0.1:8080",)
    wires = ("http",)

    def prepare(self) -> None:
        """Set its state at power on."""
        device = read_device("ugps")
        self._rules: dict[str, Any] = device["records"]
        self._no_master: dict[str, Any] = device["no_master"]
        self._station: Vector3 = self.facts.model.station
        self._true_speed = self.facts.model.assumed_speed or self.facts.sound_speed(self._station[2])
        self._stored: dict[str, Any] = self.facts.memory.setdefault("records", {})
        if not self._stored:
            self._reset()
        # What a client gave since power on, with the time.
        self._given: dict[str, tuple[int, dict[str, Any]]] = {"orientation": (0, {"orientation": -1})}
        self._sample: tuple[int, PositionSample] | None = None
        self._tracks = [Track() for _ in range(3)]
        self._patience_ns = max(2 * NS_PER_S, round(3e9 / self.facts.model.rate))

    def _reset(self) -> Response:
        first = read_device("ugps")["first"]
        self._stored |= first | {"poi": {}, "receivers": dict(enumerate(first["receivers"]))}
        self._stored["generic"] |= {"channel": self.settings.channel, "speed_of_sound": round(self._true_speed)}
        return _DONE

    def on_sample(self, topic: str, stamped: Stamped, now_ns: int) -> None:
        """Take a position of the locator."""
        self._sample = now_ns, stamped.value
        for track, value in zip(self._tracks, self._locate(now_ns) or (), strict=False):
            track.update(value, self._deviation(), stamped.value.time_ns)

    def on_request(self, method: str, path: str, query: Mapping[str, str], body: bytes, now_ns: int) -> Response:
        """Answer a request of HTTP."""
        if path.rstrip("/") == "/api":
            return _answer({"versions": ["v1"]}, "wupdater.apiversion")
        if not path.startswith("/api/v1/"):
            return _NOT_FOUND
        way = path.removeprefix("/api/v1").rstrip("/")
        family, number = (way, "") if way in _OF_MANY else way.rpartition("/")[::2]
        try:
            if family in _OF_MANY:
                return self._one_of_many(family, method, number, body)
            if way in self._rules:
                return self._one_record(way, method, body, now_ns)
        except ConfigError as error:
            if family not in _OF_MANY:
                return _answer({"success": False, "error": str(error)}, "operation_response")._replace(status=400)
            why = {"id": "0", "code": "invalid_request", "status": "400", "detail": str(error), "meta": {}}
            return Response(json.dumps(why).encode(), 400, "application/vnd.goa.error")
        if f"{method} {way}" in ("GET /about/led", "POST /imu/calibrate", "POST /imu/resetgyros"):
            return Response()
        if (method, way) == ("POST", "/about/factoryreset"):
            return self._reset()
        answer = self._answers(now_ns).get(way) if method == "GET" else None
        return _answer(*answer) if answer else _NOT_FOUND

    def _answers(self, now_ns: int) -> dict[str, tuple[Any, ...]]:
        """Return what it tells of itself and of the locator: value, type of content, and status without a value."""
        settings, stored, version = self.settings, self._stored, self.settings.version
        has_battery = stored["generic"]["locator_type"] in ("u1", "s2")
        water = self._given["depth"][1]["temp"] if "depth" in self._given else settings.water_temperature
        warnings = self._warnings(now_ns)
        ids = [warning["id"] for warning in warnings]
        about = {
            "version": f"{version} (simulated)", "version_short": version, "chipid": f"0x{self.facts.seed:08x}",
            "product_name": "Underwater GPS", "product_id": 1, "hardware_revision": 1, "variant": "standard",
        }  # fmt: skip
        status = {"imu": 2, "gps": 2 if self.facts.origin else 0, "battery": settings.battery if has_battery else -1}
        compass = {"roll": 0, "pitch": 0, "yaw": self._heading(), "state": 0, "progress": 100}
        group = {
            "status_group": "Position", "status_group_id": "position", "status": "warning" if ids else "ok",
            "message": ", ".join(ids), "error_ids": ids,
        }  # fmt: skip
        acoustic = "accoustic.position"  # as the device spells it
        return {
            "/about": (about, "about"),
            "/about/status": (status, "status"),
            "/about/temperature": ({"board": settings.board_temperature, "water": water}, "temperature"),
            "/position/acoustic/raw": (self._acoustic(self._locate(now_ns), now_ns), acoustic, 404),
            "/position/acoustic/filtered": (self._acoustic(self._filtered(), now_ns), acoustic, 404),
            "/position/global": (self._global(), "wl.satellite.position", 503),
            "/position/master": (self._master(), "wl.satellite.position", 503),
            "/imu/calibrate": (compass, "imu"),
            "/warnings": (warnings, "wl.warning", 404, _MANY),
            "/status_report": ([group], "wl.status.group", 404, _MANY),
        }

    # --- records

    def _one_record(self, way: str, method: str, body: bytes, now_ns: int) -> Response:
        """Return a record, or take one. Raises ConfigError for one that breaks its rule."""
        rule = self._rules[way]
        name = rule["name"]
        if method == "GET" and "kind" in rule:
            return _answer(self._stored.get(name) or self._given.get(name, (0, None))[1], rule["kind"], 204)
        if method != ("POST" if way.startswith("/imu") else "PUT"):
            return _NOT_FOUND
        record = _read(body, rule)
        if name in self._stored:
            self._stored[name].update(record)
        else:
            self._given[name] = now_ns, record
        return _DONE

    def _one_of_many(self, family: str, method: str, number: str, body: bytes) -> Response:
        """Answer about the points of interest, or the receivers, or one of them. Raises ConfigError."""
        rule = self._rules[family]
        stored, key = self._stored[rule["name"]], int(number[:9]) if number.isdecimal() else 0
        if number and (key not in stored or not number.isdecimal()):
            return Response(b"", 404)
        match method, rule["name"], bool(number):
            case "GET", _, False:
                return _answer(list(stored.values()), rule["kind"], many=_MANY)
            case "GET", kind, True:
                return _answer(stored[key], kind)
            case "POST", "poi", False:
                key = max(stored, default=0) + 1
                stored[key] = _read(body, rule) | {"id": key}
                return Response(json.dumps({"href": f"/poi/{key}"}).encode(), 201)
            case "DELETE", "poi", True:
                del stored[key]
            case ("PATCH", "poi", True) | ("PUT", "receivers", True):
                stored[key].update(_read(body, rule, partial=True) | {"id": key})
            case _:
                return _NOT_FOUND
        return Response(b"", 204)

    def _warnings(self, now_ns: int) -> list[dict[str, str]]:
        """Return what an operator should know, in the device's sense."""
        config = self._stored["generic"]
        found = {
            "external_depth": self._needs_depth() and self._given_depth(now_ns) is None,
            "locator_signal": self._sample is None or config["channel"] != self.settings.channel
            or now_ns - self._sample[0] > self._patience_ns,
            "external_position": config["gps"] == "external" and "master" not in self._given,
            "external_orientation": config["compass"] == "external" and "master" not in self._given,
            "gps_lock": config["gps"] == "onboard" and self.facts.origin is None,
        }  # fmt: skip
        names = [name for name, is_so in found.items() if is_so]
        return [{"id": name, "message": name.replace("_", " "), "severity": "warning"} for name in names]

    # --- where the locator is

    def _heading(self) -> float:
        """Return the heading of the housing by its own compass (degrees), which a client may have set."""
        north = self._given.get("north")
        return float(north[1]["heading"]) if north else degrees(self.settings.heading) % 360.0

    def _needs_depth(self) -> bool:
        return bool(self._stored["generic"]["locator_type"] == "a1")

    def _given_depth(self, now_ns: int) -> float | None:
        came_ns, record = self._given.get("depth", (-_DEPTH_NS, {}))
        return record["depth"] if record and now_ns - came_ns <= _DEPTH_NS else None

    def _locate(self, now_ns: int) -> Vector3 | None:
        """Return the newest position in the acoustic frame (m); None before the first, and without a depth for an A1.

        The device measures travel times, so its speed of sound scales distances from the antenna.
        """
        if self._sample is None:
            return None
        config = self._stored["generic"]
        scale = config["speed_of_sound"] / self._true_speed
        north, east, down = [scale * (x - s) for x, s in zip(self._sample[1].position, self._station, strict=True)]
        heading = self.settings.heading
        x, y = cos(heading) * north + sin(heading) * east, cos(heading) * east - sin(heading) * north
        depth = self._station[2] + down
        if self._needs_depth():
            given = self._given_depth(now_ns)
            if given is None:
                return None
            level = sqrt(max(x * x + y * y + down * down - (given - self._station[2]) ** 2, 0.0))
            share = level / (hypot(x, y) or 1.0)
            x, y, depth = share * x, share * y, given
        antenna = self._stored["antenna"]
        return x + antenna["x"], y + antenna["y"], depth

    def _filtered(self) -> Vector3 | None:
        x, y, z = [track.value for track in self._tracks]
        return None if x is None or y is None or z is None else (x, y, z)

    def _deviation(self) -> float:
        assert self._sample
        covariance = self._sample[1].covariance
        return sqrt(max(covariance[0], covariance[4], 1e-6))

    def _is_valid(self, position: Vector3, now_ns: int) -> bool:
        """Return whether the locator is heard, on its channel and inside the area of search."""
        assert self._sample
        config = self._stored["generic"]
        bearing = degrees(atan2(position[1], position[0])) - config["search_direction"]
        is_inside = abs((bearing + 180.0) % 360.0 - 180.0) <= 0.5 * config["search_sector"]
        return (
            now_ns - self._sample[0] <= self._patience_ns
            and config["channel"] == self.settings.channel
            and (is_inside or not config["antenna_enabled"])
            and hypot(position[0], position[1]) <= config["search_radius"]
            and (not self._needs_depth() or self._given_depth(now_ns) is not None)
        )

    def _acoustic(self, position: Vector3 | None, now_ns: int) -> dict[str, Any] | None:
        if position is None:
            return None
        is_valid = self._is_valid(position, now_ns)
        places = [[receiver[axis] for axis in "xyz"] for receiver in self._stored["receivers"].values()]
        distances = [dist(position, place) for place in places]
        return {
            "x": position[0], "y": position[1], "z": position[2], "std": self._deviation(),
            "position_valid": is_valid, "receiver_distance": distances,
            "receiver_rssi": [_LEVEL_AT_1M - 20.0 * log10(max(d, 0.1)) for d in distances],
            "receiver_nsd": [_NOISE] * len(distances), "receiver_valid": [int(is_valid)] * len(distances),
        }  # fmt: skip

    def _master(self) -> dict[str, Any] | None:
        """Return the topside's position and heading; None without one."""
        config, external = self._stored["generic"], self._given.get("master", (0, None))[1]
        if "external" in (config["gps"], config["compass"]) and external is None:
            return None
        found: dict[str, Any] = {"fix_quality": 1}
        if config["gps"] == "external":
            found = dict(external or {})
        elif config["gps"] == "static":
            found |= {"lat": config["static_lat"], "lon": config["static_lon"]}
        elif self.facts.origin:
            plane = TangentPlane(*self.facts.origin, self.facts.origin_altitude)
            latitude, longitude, _ = plane.geodetic((self._station[0], self._station[1], 0.0))
            found |= {"lat": latitude, "lon": longitude, "sog": 0, "hdop": 0.9, "numsats": 11}
        else:
            return None
        headings = {
            "onboard": self._heading(), "static": config["static_orientation"],
            "external": (external or {}).get("orientation"),
        }  # fmt: skip
        return self._no_master | found | {"orientation": headings[config["compass"]]}

    def _global(self) -> dict[str, Any] | None:
        master, position = self._master(), self._filtered()
        if master is None or position is None:
            return None
        heading = radians(master["orientation"])
        x, y, depth = position
        north, east = cos(heading) * x - sin(heading) * y, sin(heading) * x + cos(heading) * y
        latitude, longitude, _ = TangentPlane(master["lat"], master["lon"]).geodetic((north, east, depth))
        return master | {"lat": latitude, "lon": longitude} | self._given["orientation"][1]


def _read(body: bytes, rule: dict[str, Any], *, partial: bool = False) -> dict[str, Any]:
    """Return the record in `body` with its known fields. Raises ConfigError if it breaks the rule."""
    try:
        given = json.loads(body)
    except (ValueError, RecursionError):
        raise ConfigError("body is no JSON") from None
    if not isinstance(given, dict):
        raise ConfigError("body is no JSON object")
    fields = rule["fields"]
    missing = [name for name in fields if name not in given and name not in rule.get("optional", ())]
    if missing and not partial:
        raise ConfigError(f"missing required attributes: {', '.join(missing)}")
    known = {name: value for name, value in given.items() if name in fields}
    if wrong := [name for name, value in known.items() if not fits(value, fields[name])]:
        raise ConfigError(f"invalid value of {', '.join(wrong)}")
    return known


def _answer(value: Any, kind: str, missing: int = 404, many: str = "") -> Response:
    """Return a value; the status `missing` if there is none."""
    if value is None:
        return Response(b"", missing)
    return Response(json.dumps(value).encode(), 200, f"application/vnd.waterlinked.{kind}+json{many}")


_DONE = _answer({"success": True}, "operation_response")
_NOT_FOUND = Response(b"404 page not found\n", 404, "text/plain")
