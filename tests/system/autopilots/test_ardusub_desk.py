"""A BlueROV2's desk: the real ArduSub dives while the makers' clients read all instruments at their wires, at once."""

import json
import os
import socket
import threading
import urllib.error
import urllib.request
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from statistics import median
from typing import Any, cast

import pytest
from brping import Ping1D, Ping360, definitions

from hil.client.client import VehicleClient
from hil.common.ports import free_ports
from hil.common.schema import find_preset
from tests.support.clients.ground_station import Mission, fly_live
from tests.support.processes import PATIENCE_S, Program, wait_for
from tests.system.autopilots.test_ardusub import BATTERY
from tests.system.autopilots.test_ardusub_stm32 import LIMIT_S, Vehicle

PROGRAM = os.environ.get("UUV_HIL_ARDUSUB", "")
pytestmark = [
    pytest.mark.skipif(not PROGRAM, reason="UUV_HIL_ARDUSUB does not name ArduSub's SITL program"),
    pytest.mark.timeout(900),
]
WET_BELOW = 1.5  # m
Read = Callable[[], Any]


def dvl(port: int, stack: ExitStack) -> Read:
    connection = stack.enter_context(socket.create_connection(("127.0.0.1", port), PATIENCE_S))
    opened = stack.enter_context(connection.makefile("rb"))

    def read() -> Any:
        while (report := json.loads(opened.readline()))["type"] != "velocity":
            pass
        return report

    return read


def ping2(port: int, stack: ExitStack) -> Read:
    client = Ping1D(payload_dict=definitions.payload_dict_ping1d)
    client.connect_udp("127.0.0.1", port)
    stack.callback(client.iodev.close)
    assert wait_for(client.initialize)
    return cast(Read, client.get_distance)


def ping360(port: int, stack: ExitStack) -> Read:
    client = Ping360()
    client.connect_udp("127.0.0.1", port)
    stack.callback(client.iodev.close)
    assert wait_for(client.initialize)
    client.set_number_of_samples(600)
    client.set_sample_period(400)
    return lambda: client.transmitAngle(200)


def ugps(port: int, _: ExitStack) -> Read:
    def read() -> Any:
        try:
            url = f"http://127.0.0.1:{port}/api/v1/position/acoustic/filtered"
            with urllib.request.urlopen(url, timeout=PATIENCE_S) as response:
                return json.load(response)
        except urllib.error.HTTPError:  # no position yet
            return None

    return read


AT: dict[str, tuple[str, Callable[[int, ExitStack], Read]]] = {
    "dvl": ("tcp", dvl), "echosounder": ("udp", ping2), "scanning_sonar": ("udp", ping360), "usbl": ("http", ugps),
}  # fmt: skip


def options(folder: Path, port: int, ports: list[int]) -> list[str]:
    """Return what a slave is told: ArduSub, a battery, a leak, and free ports."""
    path = folder / "powered.toml"
    path.write_text(Path(find_preset("sim/vehicles", "bluerov2_heavy_t200")).read_text() + BATTERY)
    own = {"program": PROGRAM, "folder": str(folder / "ardusub"), "parameters": "ardupilot_bluerov2_heavy"}
    changes = [f"autopilot.{key}={value!r}" for key, value in own.items()]
    changes += ["controller=ardupilot", "autopilot.wipe=true", "autopilot.instance=6", f"vehicle={str(path)!r}"]
    changes += [f"slave.listen='tcp/127.0.0.1:{port}'", "sensors.battery={}", f"sensors.leak={{below={WET_BELOW}}}"]
    for (name, (kind, _)), place in zip(AT.items(), ports, strict=True):
        changes.append(f"sensors.{name}.at='{kind}:127.0.0.1:{place}'")
    return [word for change in changes for word in ("--set", change)]


class Desk:
    """The vehicle of a slave, and what the clients of its instruments read: the depth then, and the answer."""

    def __init__(self, vehicle: Vehicle) -> None:
        self.vehicle = vehicle
        self.ending = threading.Event()
        self.depths: list[float] = []
        self.seen: dict[str, list[tuple[float, Any]]] = {name: [] for name in AT}

    def follow(self, name: str, read: Read) -> None:
        """Read an instrument until the end."""
        while not self.ending.wait(0.05):
            if (found := read()) is not None:
                self.seen[name].append((self.vehicle.depth, found))

    def mission(self) -> Mission:
        """Dive, and hold the depth."""
        yield from self.vehicle.dive(2.0)
        for answers in self.seen.values():
            answers.clear()  # of the way down
        yield from self.vehicle.hold(20.0, self.depths)
        yield lambda: "BATTERY_STATUS" in self.vehicle.station.latest


def check(desk: Desk) -> None:
    """Check what was read while the depth was held."""
    depths, seen = desk.depths, desk.seen
    print(f"depth {min(depths):.2f} to {max(depths):.2f} m; { ({name: len(found) for name, found in seen.items()}) }")
    assert max(depths) - min(depths) < 0.3
    assert min(depths) > WET_BELOW
    assert all(len(found) > 10 for found in seen.values()), seen
    assert all(report["velocity_valid"] for _, report in seen["dvl"])
    altitude = median(report["altitude"] for _, report in seen["dvl"])
    assert 1e-3 * median(each["distance"] for _, each in seen["echosounder"]) == pytest.approx(altitude, abs=0.5)
    assert all(len(ping.data) == 600 for _, ping in seen["scanning_sonar"])
    assert median(abs(position["z"] - depth) for depth, position in seen["usbl"]) < 0.5


def test_ardusub_dives_while_clients_read_dvl_ping2_ping360_and_ugps(tmp_path: Path) -> None:
    port, *ports = free_ports(5)
    command = "slave", "bluerov2_desk", *options(tmp_path, port, ports)
    with Program(tmp_path, *command) as slave, ExitStack() as stack, ThreadPoolExecutor() as pool:
        for name in AT:
            slave.expect(f"{name}: .* at ")
        with VehicleClient(f"tcp/127.0.0.1:{port}", "uuv1", role="observer") as client:
            client.watch("battery")
            desk = Desk(Vehicle(slave, client))
            station = desk.vehicle.station
            try:
                assert wait_for(lambda: "ground_truth" in client.latest)
                clients = zip(AT.items(), ports, strict=True)
                opened = [(name, connect(place, stack)) for (name, (_, connect)), place in clients]
                readers = [pool.submit(desk.follow, name, read) for name, read in opened]
                fly_live(station, desk.mission(), LIMIT_S)
            finally:
                desk.ending.set()
                station.close()
            for reader in readers:
                reader.result(PATIENCE_S)
            volts = client.latest["battery"].value.voltage
    check(desk)
    assert 1e-3 * station.latest["BATTERY_STATUS"].voltages[0] == pytest.approx(volts, abs=0.3)
    assert station.output("Leak Detected")
