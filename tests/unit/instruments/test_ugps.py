"""The UGPS: what it answers by HTTP before and after there is a position, and what its settings change."""

import json
from math import hypot, radians
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.instruments.ugps import Track, Ugps, UgpsSettings
from sim.geodesy import TangentPlane
from sim.sensors.extra_samples import PositionSample
from sim.sensors.usbl import UsblModel
from tests.support.instrument_bench import Bench

ORIGIN = (63.4, 10.4)
VARIANCE = (0.04, 0.0, 0.0, 0.0, 0.04, 0.0, 0.0, 0.0, 0.09)
GENERIC = {
    "channel": 3, "locator_type": "u1", "gps": "onboard", "compass": "onboard", "static_lat": 0, "static_lon": 0,
    "static_orientation": 0,
}  # fmt: skip


class Topside(Bench):
    """A topside at 10 m north, 1 m deep, that looks east."""

    def __init__(self, **facts: Any) -> None:
        model = UsblModel(rate=4.0, station=(10.0, 0.0, 1.0))
        super().__init__(Ugps, model, UgpsSettings(heading=radians(90.0)), **({"origin": ORIGIN} | facts))

    def http(self, method: str, path: str, value: Any = None) -> tuple[int, Any]:
        body = value if isinstance(value, bytes) else json.dumps(value).encode()
        response = self.device.on_request(method, f"/api/v1{path}", {}, body, self.now_ns)
        return response.status, json.loads(response.body) if "json" in response.content_type and response.body else None

    def fix(self, north: float, east: float, down: float, times: int = 1) -> None:
        for _ in range(times):
            self.now_ns += 250_000_000
            self.sample(PositionSample(self.now_ns, (north, east, down), VARIANCE))


def test_there_is_no_position_before_the_first() -> None:
    topside = Topside()
    for path, status in (("acoustic/raw", 404), ("acoustic/filtered", 404), ("global", 503), ("master", 200)):
        assert topside.http("GET", f"/position/{path}")[0] == status
    assert Topside(origin=None).http("GET", "/position/master")[0] == 503
    assert topside.http("GET", "/nothing")[0] == 404
    assert topside.device.on_request("GET", "/api/", {}, b"", 0).body == b'{"versions": ["v1"]}'


def test_positions_are_ahead_and_to_the_right_of_the_housing_and_on_the_earth() -> None:
    topside = Topside()
    topside.fix(30.0, 5.0, 12.0, times=8)
    _, raw = topside.http("GET", "/position/acoustic/raw")
    assert (raw["x"], raw["y"], raw["z"]) == pytest.approx((5.0, -20.0, 12.0))
    assert (raw["std"], raw["position_valid"], raw["receiver_valid"]) == (0.2, True, [1, 1, 1, 1])
    assert raw["receiver_distance"] == pytest.approx([hypot(5, 20, 11)] * 4, abs=0.3)
    assert raw["receiver_rssi"] == pytest.approx([-102.9] * 4, abs=0.3)
    _, place = topside.http("GET", "/position/global")
    assert TangentPlane(*ORIGIN).local(place["lat"], place["lon"], -12.0) == pytest.approx((30.0, 5.0, 12.0), abs=0.02)
    assert (place["orientation"], place["numsats"]) == (-1, 11)
    topside.http("PUT", "/external/orientation", {"orientation": 42})
    assert topside.http("GET", "/position/global")[1]["orientation"] == 42
    topside.now_ns += 10**10
    assert not topside.http("GET", "/position/acoustic/filtered")[1]["position_valid"]
    assert "locator_signal" in [w["id"] for w in topside.http("GET", "/warnings")[1]]


def test_an_a1_needs_the_depth_of_its_client() -> None:
    topside = Topside()
    assert topside.http("PUT", "/config/generic", GENERIC | {"locator_type": "a1"}) == (200, {"success": True})
    topside.fix(30.0, 0.0, 1.0)
    assert topside.http("GET", "/position/acoustic/filtered")[0] == 404
    assert topside.http("GET", "/about/status")[1]["battery"] == -1
    assert topside.http("PUT", "/external/depth", {"depth": 13.0, "temp": 7.5}) == (200, {"success": True})
    topside.fix(30.0, 0.0, 1.0)
    position = topside.http("GET", "/position/acoustic/filtered")[1]
    # The range of 20 m is kept, so a depth of 12 m below the antenna leaves 16 m level.
    assert (position["x"], position["y"], position["z"]) == pytest.approx((0.0, -16.0, 13.0))
    assert topside.http("GET", "/about/temperature")[1] == {"board": 37.0, "water": 7.5}


def test_settings_change_what_is_found_and_outlive_the_power() -> None:
    topside = Topside()
    topside.fix(30.0, 0.0, 1.0)
    for change in ({"channel": 4}, {"search_radius": 15}, {"search_sector": 90, "search_direction": 90}):
        assert topside.http("PUT", "/config/generic", GENERIC | change)[0] == 200
        assert not topside.http("GET", "/position/acoustic/raw")[1]["position_valid"], change
        topside.http("POST", "/about/factoryreset")
    topside.http("PUT", "/config/generic", GENERIC | {"speed_of_sound": 1650})
    assert topside.http("GET", "/position/acoustic/raw")[1]["y"] == pytest.approx(-22.0)
    topside.restart()
    assert topside.http("GET", "/config/generic")[1]["speed_of_sound"] == 1650
    assert topside.http("PUT", "/config/antenna", {"x": 1, "y": 2, "depth": 1, "antenna_rotation": 0})[0] == 200
    topside.fix(30.0, 0.0, 1.0)
    raw = topside.http("GET", "/position/acoustic/raw")[1]
    assert (raw["x"], raw["y"]) == pytest.approx((1.0, -20.0))


def test_an_external_master_replaces_the_own_receiver_and_compass() -> None:
    topside = Topside(origin=None)
    topside.http("PUT", "/config/generic", GENERIC | {"gps": "external", "compass": "external"})
    topside.fix(10.0, -20.0, 1.0)
    assert topside.http("GET", "/position/global")[0] == 503
    assert topside.http("PUT", "/external/master", {"lat": 50.0, "lon": 8.0, "orientation": 180.0})[0] == 200
    _, master = topside.http("GET", "/position/master")
    assert (master["lat"], master["orientation"], master["sog"], master["fix_quality"]) == (50.0, 180.0, -1, 0)
    _, place = topside.http("GET", "/position/global")
    assert TangentPlane(50.0, 8.0).local(place["lat"], place["lon"], -1.0) == pytest.approx((20.0, 0.0, 1.0), abs=0.01)


@pytest.mark.parametrize(
    ("path", "body"),
    [
        ("/config/generic", {"channel": 3}),
        ("/config/generic", GENERIC | {"gps": "galileo"}),
        ("/config/antenna", {"x": 1000, "y": 0, "depth": 1, "antenna_rotation": 0}),
        ("/external/depth", {"depth": "3", "temp": 1}),
        ("/external/master", b"{"),
        ("/external/depth", b'{"depth": NaN, "temp": 1}'),
    ],
)
def test_records_that_break_a_rule_are_refused(path: str, body: Any) -> None:
    topside = Topside()
    status, answer = topside.http("PUT", path, body)
    assert (status, answer["success"]) == (400, False)
    assert answer["error"]


def test_points_of_interest_and_receivers_can_be_kept() -> None:
    topside = Topside()
    point = {"name": "wreck", "lat": 1.0, "lng": 2.0, "depth": 3.0, "icon": "x", "visible": True}
    assert topside.http("POST", "/poi/", point)[0] == 201
    assert topside.http("PATCH", "/poi/1", {"depth": 4.0})[0] == 204
    assert topside.http("GET", "/poi/") == (200, [point | {"id": 1, "depth": 4.0}])
    assert topside.http("DELETE", "/poi/1")[0] == 204
    assert topside.http("GET", "/poi/1")[0] == 404
    assert topside.http("PUT", "/config/receivers/2", {"z": 2.5})[0] == 204
    assert topside.http("GET", "/config/receivers/")[1][2]["z"] == 2.5


ONE = Topside()


@given(st.sampled_from(["GET", "PUT", "POST", "DELETE", "PATCH"]), st.text(max_size=20), st.binary(max_size=60))
def test_no_request_upsets_it(method: str, way: str, body: bytes) -> None:
    topside = ONE
    for path in (f"/{way}", f"/poi/{way}", f"/config/receivers/{way}", "/external/depth", "/poi"):
        assert topside.http(method, path, body)[0] in (200, 201, 204, 400, 404, 503)


def test_the_filter_follows_a_constant_velocity_with_less_noise() -> None:
    track = Track()
    errors = []
    for i in range(200):
        noise = 0.5 if i % 2 else -0.5
        track.update(0.2 * i + noise, 0.5, i * 10**9)
        assert track.value is not None
        errors.append(abs(track.value - 0.2 * i))
    assert max(errors[50:]) < 0.35
