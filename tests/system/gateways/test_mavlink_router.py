"""The MAVLink vehicle behind the real mavlink-router, where UUV_HIL_MAVLINK_ROUTER names its program."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from hil.common.children import start_child
from hil.gateways.mavlink.flight.modes import Mode
from tests.support.clients.mavlink_ground import Ground
from tests.support.processes import Program, free_port, write_scenario

ROUTER = os.environ.get("UUV_HIL_MAVLINK_ROUTER", "")
pytestmark = pytest.mark.skipif(not ROUTER, reason="UUV_HIL_MAVLINK_ROUTER does not name mavlink-routerd")
LAYOUT = '[mavlink]\nendpoints = ["udpin:127.0.0.1:{vehicle}"]\nparameters = "{file}"\n'
CONFIGURATION = """
[General]
TcpServerPort = {tcp}
ReportStats = false
[UdpEndpoint vehicle]
Mode = Normal
Address = 127.0.0.1
Port = {vehicle}
[UdpEndpoint station]
Mode = Server
Address = 127.0.0.1
Port = {udp}
"""


@pytest.fixture
def stations(tmp_path: Path) -> Iterator[tuple[Ground, Ground]]:
    """Provide two ground stations at the router, one by UDP and one by TCP."""
    vehicle, udp, tcp = free_port(), free_port(), free_port()
    scenario, _ = write_scenario(tmp_path)
    scenario.write_text(scenario.read_text() + LAYOUT.format(vehicle=vehicle, file=tmp_path / "parameters.toml"))
    configuration = tmp_path / "router.conf"
    configuration.write_text(CONFIGURATION.format(vehicle=vehicle, udp=udp, tcp=tcp))
    with Program(tmp_path, "slave", scenario) as slave:
        slave.expect("MAVLink system 1 is uuv1")
        router = start_child([ROUTER, "-c", str(configuration)])
        try:
            pair = Ground(f"udpout:127.0.0.1:{udp}", 255), Ground(f"tcp:127.0.0.1:{tcp}", 254, retries=60)
            yield pair
            for ground in pair:
                ground.link.close()
        finally:
            router.terminate()
            router.wait(30)


def test_two_ground_stations_use_the_vehicle_at_the_same_time(stations: tuple[Ground, Ground]) -> None:
    first, second = stations
    for ground in stations:
        assert ground.connect().get_srcSystem() == 1
    for number, ground in enumerate(stations):
        ground.send.param_request_list_send(1, 1)
        count = ground.wait("PARAM_VALUE").param_count
        seen: set[str] = set()

        def complete(value: object, seen: set[str] = seen, count: int = count) -> bool:
            seen.add(str(getattr(value, "param_id", "")))
            return len(seen) >= count - 1  # the first is gone already

        assert ground.wait("PARAM_VALUE", complete), f"station {number} has {len(seen)} of {count} parameters"
    first.set_mode(Mode.MANUAL)
    first.arm()
    assert second.wait("HEARTBEAT", lambda beat: beat.base_mode & 128), "the other sees it armed"
    first.wait("LOCAL_POSITION_NED", lambda place: abs(place.vx) + abs(place.vy) > 0.1, lambda: first.sticks(x=800))
    second.wait("LOCAL_POSITION_NED", lambda place: abs(place.vx) + abs(place.vy) > 0.05, lambda: first.sticks(x=800))
    second.disarm()
    assert first.wait("HEARTBEAT", lambda beat: not beat.base_mode & 128), "the first sees it disarmed by the other"
