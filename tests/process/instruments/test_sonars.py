"""A real slave whose sonars and camera stand at their wires, read by the makers' own clients, unmodified."""

import io
import shutil
import socket
import subprocess
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import wlsonar
from brping import Ping1D, Ping360, PingDevice, definitions
from PIL import Image
from wlsonar.range_image_protocol import RangeImage, UnknownProtobufTypeError, unpackb

from hil.common.ports import free_ports
from tests.support.processes import PATIENCE_S, Program, wait_for, write_scenario

SENSORS = """
[sensors.echosounder]
instrument = "ping2"
at = ["udp:127.0.0.1:{ping2}", "pty:{folder}/ping2"]

[sensors.scanning_sonar]
instrument = "ping360"
at = ["udp:127.0.0.1:{ping360}", "pty:{folder}/ping360"]

[sensors.camera]
width = 64
height = 48
rate = 5.0
instrument = "network_camera"
at = "http:127.0.0.1:{camera}"

[sensors.laser]
rate = 1.0
instrument = "waterlinked_sonar_3d"
at = ["http:127.0.0.1:{sonar}", "udp:127.0.0.1:{images}"]
"""
NAMES = "ping2", "ping360", "sonar", "images", "camera"
Where = tuple[Path, dict[str, int]]
Open = Callable[[PingDevice, str], None]


@pytest.fixture(scope="module", name="where")
def a_vehicle(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Where]:
    folder = tmp_path_factory.mktemp("sonars")
    scenario, _ = write_scenario(folder)
    ports = {name: free_ports(1)[0] for name in NAMES}
    scenario.write_text(scenario.read_text() + SENSORS.format(folder=folder, **ports))
    with Program(folder, "slave", scenario) as slave:
        for name in ("echosounder", "scanning_sonar", "laser", "camera"):
            slave.expect(f"{name}: .* at (udp|http):")
        yield folder, ports
    assert "Traceback" not in slave.output


@pytest.fixture(name="connect", params=["udp", "pty"])
def a_wire(request: pytest.FixtureRequest, where: Where) -> Iterator[Open]:
    folder, ports = where
    opened: list[PingDevice] = []

    def connect(client: PingDevice, name: str) -> None:
        opened.append(client)
        if request.param == "udp":
            client.connect_udp("127.0.0.1", ports[name])
        else:
            client.connect_serial(str(folder / name), 230_400)  # which the device takes from its first byte

    yield connect
    for client in opened:
        client.iodev.close()


def answer(ask: Callable[[], Any]) -> Any:
    """Return what a client was answered, when it was."""
    answered = wait_for(ask)
    assert answered
    return answered


def test_blue_robotics_client_reads_an_echo_sounder(connect: Open) -> None:
    client = Ping1D(payload_dict=definitions.payload_dict_ping1d)
    connect(client, "ping2")
    assert wait_for(client.initialize)
    assert answer(client.get_device_information)["device_revision"] == 2
    assert wait_for(lambda: (client.get_distance() or {"confidence": 0})["confidence"] > 50)
    distance = answer(client.get_distance_simple)["distance"]
    assert answer(client.get_distance)["distance"] == pytest.approx(distance, abs=500)
    client.control_continuous_start(definitions.PING1D_PROFILE)
    numbers = [client.wait_message([definitions.PING1D_PROFILE], PATIENCE_S).ping_number for _ in range(4)]
    client.control_continuous_stop(definitions.PING1D_PROFILE)
    assert numbers == sorted(set(numbers))


def test_blue_robotics_client_scans_with_a_ping360(connect: Open) -> None:
    client = Ping360()
    connect(client, "ping360")
    assert wait_for(client.initialize)
    for name, value in {"gain_setting": 2, "sample_period": 400, "number_of_samples": 800}.items():
        getattr(client, f"set_{name}")(value)
    pings = [answer(partial(client.transmitAngle, angle)) for angle in (0, 100, 200)]
    assert [(ping.angle, ping.number_of_samples, len(ping.data)) for ping in pings] == [
        (0, 800, 800), (100, 800, 800), (200, 800, 800),
    ]  # fmt: skip
    assert max(pings[2].data[100:]) > 50  # a wall of the pool


@pytest.mark.skipif(not shutil.which("ffmpeg"), reason="ffmpeg is not installed")
def test_ffmpeg_reads_the_pictures_of_a_camera(where: Where, tmp_path: Path) -> None:
    url = f"http://127.0.0.1:{where[1]['camera']}/?action="
    command = ["ffmpeg", "-loglevel", "error", "-i", f"{url}stream", "-frames:v", "3", f"{tmp_path}/%d.png"]
    subprocess.run(command, check=True, timeout=PATIENCE_S)
    shown = [Image.open(io.BytesIO(path.read_bytes())) for path in tmp_path.glob("*.png")]
    assert [picture.size for picture in shown] == [(64, 48)] * 3
    with urllib.request.urlopen(f"{url}snapshot", timeout=PATIENCE_S) as response:
        assert Image.open(io.BytesIO(response.read())).format == "JPEG"


def receive_image(images: socket.socket) -> RangeImage:
    images.settimeout(PATIENCE_S)
    while True:
        try:
            image = unpackb(images.recv(65_536), known_message_types=(RangeImage,))
        except UnknownProtobufTypeError:
            continue
        assert isinstance(image, RangeImage)
        return image


def test_water_linkeds_client_sets_a_3d_sonar_and_receives_its_images(where: Where) -> None:
    sonar = wlsonar.Sonar3D("127.0.0.1", where[1]["sonar"], timeout=PATIENCE_S)
    port = free_ports(1)[0]
    assert sonar.get_status().api.operational
    assert sonar.get_temperature() > 0.0
    assert abs(sonar.get_time_status().system_time.timestamp() - time.time()) < PATIENCE_S
    for name, value in {
        "acoustics_enabled": True, "speed_of_sound": 1480.0, "mode": "high-frequency", "salinity": "fresh",
        "output_imu_batch_enabled": True,
    }.items():  # fmt: skip
        getattr(sonar, f"set_{name}")(value)
        assert getattr(sonar, f"get_{name}")() == value
    sonar.set_range(0.5, 12.0)
    assert sonar.get_range() == (0.5, 12.0)
    with wlsonar.open_sonar_udp_unicast_socket(udp_port=port, iface_ip="127.0.0.1") as images:
        sonar.set_udp_unicast("127.0.0.1", port)
        image = receive_image(images)
    assert (image.speed_of_sound, image.range, image.fov_horizontal) == (1480.0, 12.0, 40.0)
    assert sum(pixel > 0 for pixel in image.image_pixel_data) > 1000
    with wlsonar.open_sonar_udp_multicast_socket(iface_ip="127.0.0.1") as images:
        sonar.set_udp_multicast()
        assert receive_image(images).header.sequence_id > image.header.sequence_id
    sonar.set_udp_disabled()
    assert sonar.get_udp_config().mode == "disabled"
