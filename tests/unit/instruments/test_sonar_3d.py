"""The Sonar 3D-15: its packets read by the maker's own library, and what its settings change."""

import json
from collections.abc import Iterator
from math import cos, radians
from typing import Any

import numpy as np
import pytest
import wlsonar
from hypothesis import given
from hypothesis import strategies as st
from wlsonar.range_image_protocol import BitmapImageGreyscale8, ImuBatch, RangeImage, unpackb

from hil.common.clock import NS_PER_S, to_wall_ns
from hil.instruments.contract import Client
from hil.instruments.sonar_3d import Sonar3D, Sonar3DSettings, image_head, range_image
from sim.environment.obstacles import Box
from sim.sensors.mounting import Mounting
from sim.sensors.samples import ImuSample
from tests.support.clients.datagrams import Datagrams
from tests.support.fitted import FLAT

WALL = FLAT._replace(depth=200.0, box=(Box(north=7.0, east=0.0, size_north=2.0, size_east=100.0),))
KNOWN = (RangeImage, BitmapImageGreyscale8, ImuBatch)


class Sonar(Datagrams):
    """A sonar 6 m before a wall."""

    def __init__(self, settings: Sonar3DSettings = Sonar3DSettings(), **facts: Any) -> None:
        super().__init__(Sonar3D, WALL, settings, **facts)
        self.post("udp", {"mode": "multicast", "unicast_destination_ip": "", "unicast_destination_port": 0})

    def http(self, method: str, name: str, body: bytes = b"") -> tuple[int, Any]:
        response = self.device.on_request(method, f"/api/v1/integration/{name}", {}, body, self.now_ns)
        return response.status, json.loads(response.body) if response.status == 200 else None

    def post(self, name: str, value: Any) -> int:
        return self.http("POST", name, json.dumps(value).encode())[0]

    @property
    def last_client(self) -> Client:
        client = self.log[-1][1]
        assert client
        return client

    def images(self, seconds: float) -> Iterator[Any]:
        del self.log[:]
        self.pass_time(seconds)
        for data, *_ in self.log:
            yield unpackb(data, known_message_types=KNOWN)


def test_a_wall_stands_where_the_makers_library_finds_it() -> None:
    sonar = Sonar()
    images = list(sonar.images(1.0))
    assert isinstance(images[0], RangeImage)
    assert isinstance(images[1], BitmapImageGreyscale8)
    assert len(images) == pytest.approx(10, abs=2)
    image, strengths = images[:2]
    assert (image.width, image.height, image.fov_horizontal, image.fov_vertical) == (256, 64, 90.0, 40.0)
    assert (image.speed_of_sound, image.range, image.frequency) == (1500.0, 15.0, 1_200_000)
    points = np.array([p for p in wlsonar.range_image_to_xyz(image) if p])
    assert len(points) > 10_000
    assert points[:, 0].mean() == pytest.approx(6.0, abs=0.02)
    assert points[:, 0].std() < 0.05
    assert points[:, 1].max() - points[:, 1].min() > 10.0
    linear = np.array(wlsonar.bitmap_image_to_strength_linear(strengths)).reshape(64, 256)
    ranges = np.array(wlsonar.range_image_to_distance(image), float).reshape(64, 256)
    assert ((linear > 0) == np.isfinite(ranges))[5:-5].mean() > 0.95
    assert linear[32, 128] > 1.5 * linear[32, 30]  # slanting echoes are weaker
    assert [i.header.sequence_id for i in images[:4]] == [0, 0, 1, 1]
    assert abs(image.header.timestamp.ToNanoseconds() - to_wall_ns(sonar.now_ns)) < 2 * NS_PER_S


def test_settings_change_the_image_and_outlive_the_power() -> None:
    sonar = Sonar()
    assert sonar.post("acoustics/speed_of_sound", 1350.0) == 204
    assert sonar.post("acoustics/mode", "high-frequency") == 204
    images = list(sonar.images(1.0))
    assert len(images) == pytest.approx(40, abs=4)
    image = images[0]
    assert (image.fov_horizontal, image.frequency) == (40.0, 2_400_000)
    middle = image.image_pixel_data[32 * 256 + 128] * image.image_pixel_scale
    assert middle == pytest.approx(5.4 / cos(radians(20.0 / 63)), abs=0.05)
    sonar.restart()
    assert sonar.http("GET", "acoustics/mode") == (200, "high-frequency")
    assert sonar.post("acoustics/range", {"min": 0.0, "max": 5.0}) == 204
    assert not any(next(iter(sonar.images(0.2))).image_pixel_data)
    assert sonar.post("acoustics/enabled", False) == 204
    sonar.pass_time(0.1)  # the image on its way is sent
    assert not list(sonar.images(1.0))


def test_packets_go_where_the_settings_say() -> None:
    sonar = Sonar()
    sonar.pass_time(0.3)
    assert sonar.last_client.address == ("224.0.0.96", 4747)
    unicast = {"mode": "unicast", "unicast_destination_ip": "192.0.2.7", "unicast_destination_port": 5000}
    sonar.post("udp", unicast)
    sonar.pass_time(0.3)
    assert (sonar.last_client.address, sonar.last_client.kind) == (("192.0.2.7", 5000), "udp")
    sonar.post("udp", unicast | {"mode": "disabled"})
    assert not list(sonar.images(1.0))


def test_inertial_samples_come_in_batches_in_the_axes_of_the_sonar() -> None:
    sonar = Sonar(mounting=Mounting(orientation=(0.0, 0.0, radians(90.0))))
    sonar.post("output/imu-batch/enabled", True)
    del sonar.log[:]
    for i in range(10):
        sonar.feed(ImuSample(i * 10_000_000, (1.0, 0.0, 0.0, 0.0), (0.1, 0.2, 0.3), (1.0, 2.0, -9.8)), "imu")
    batches = [unpackb(data, known_message_types=KNOWN) for data, *_ in sonar.log]
    batches = [batch for batch in batches if isinstance(batch, ImuBatch)]
    assert [(batch.batch_sequence_id, batch.samples) for batch in batches] == [(0, 5), (1, 5)]
    assert list(batches[1].specific_force)[:3] == pytest.approx([2.0, -1.0, -9.8])
    assert list(batches[1].rate_of_turn)[:3] == pytest.approx([0.2, -0.1, 0.3])
    assert batches[1].timestamp[0].ToNanoseconds() == 50_000_000


def test_a_clock_without_a_server_of_time_can_be_set() -> None:
    now = json.dumps({"now": "2031-05-06T07:08:09+00:00"}).encode()
    assert Sonar().http("POST", "time/manual", now)[0] == 409
    sonar = Sonar(Sonar3DSettings(synchronised=False))
    assert sonar.http("POST", "time/manual", now)[0] == 204
    assert sonar.http("GET", "time/status")[1]["system_time"].startswith("2031-05-06T07:08:")
    assert next(iter(sonar.images(0.3))).header.timestamp.ToJsonString().startswith("2031-05-06T07:08:")


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("acoustics/range", {"min": 3.0, "max": 2.0}),
        ("acoustics/range", 5),
        ("acoustics/mode", "medium-frequency"),
        ("acoustics/salinity", "low-frequency"),
        ("acoustics/enabled", 1),
        ("acoustics/speed_of_sound", float("nan")),
        ("udp", {"mode": "unicast", "unicast_destination_ip": "", "unicast_destination_port": 1}),
        ("udp", {"mode": "unicast", "unicast_destination_ip": "192.0.2.1", "unicast_destination_port": 0}),
        ("time/manual", {"now": "noon"}),
        ("time/manual", {"now": "1969-12-31T23:59:59Z"}),
        ("time/manual", {"now": "9999-12-31T23:59:59Z"}),
    ],
)
def test_a_wrong_setting_is_refused_and_changes_nothing(name: str, value: Any) -> None:
    sonar = Sonar()
    before = sonar.http("GET", name)
    assert sonar.post(name, value) == 400
    assert sonar.http("GET", name) == before


ONE = Sonar()


@given(st.sampled_from([*ONE.facts.memory["settings"], "time/manual", "x"]), st.binary(max_size=60))
def test_no_request_upsets_it(name: str, body: bytes) -> None:
    assert ONE.http("POST", name, body)[0] in (204, 400, 404)


def test_pixels_of_all_sizes_are_packed_and_the_largest_image_fits_in_a_datagram() -> None:
    head, view = image_head(2**62, 2**32 - 1, 1500.0, 15.0, 2_400_000), (256, 64, 90.0, 40.0)
    values = [0, 1, 127, 128, 16_383, 16_384, 65_535]
    image = unpackb(range_image(head, view, 0.001, np.array(values)), known_message_types=KNOWN)
    assert list(image.image_pixel_data) == values
    assert len(range_image(head, view, 0.001, np.full(16_384, 0xFFFF))) < 65_507
