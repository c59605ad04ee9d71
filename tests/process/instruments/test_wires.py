"""A real slave whose instruments stand at pseudo-terminals and ports, read by programs of others, unmodified."""

import json
import shutil
import socket
import time
from collections.abc import Iterator
from pathlib import Path
from struct import unpack_from
from typing import Any, NamedTuple

import pytest
import serial
from keller_protocol.keller_protocol import KellerProtocol
from trdi_adcp_readers.pd0 import pd0_parser
from vectornav import VN200

from hil.common.children import start_child
from tests.support.processes import PATIENCE_S, Program, free_port, wait_for, write_scenario

WORLD = """
name = "harbour basin"
source = "a test"
extent = [-10.0, 20.0, -10.0, 20.0]
depth = 5.0
origin = [57.7, 11.9]
origin_altitude = 36.2
magnetic_field = [5e-5, "70 deg", "4 deg"]
"""
SENSORS = """
[sensors.gps]
rate = 5.0
position = [0.0, 0.0, -0.6]
instrument = "ublox_m9"
at = "pty:{folder}/gps"

[sensors.imu]
rate = 100.0
instrument = "vectornav_vn200"
at = "pty:{folder}/imu"

[sensors.pressure]
instrument = "keller_33x"
at = "pty:{folder}/pressure"

[sensors.dvl]
instrument = "teledyne_pathfinder"
at = "pty:{folder}/dvl"

[sensors.usbl]
instrument = "seatrac"
at = ["pty:{folder}/x150", "pty:{folder}/x110"]
"""


class Wires(NamedTuple):
    """Where the instruments of a running slave stand."""

    folder: Path

    def line(self, name: str) -> str:
        """Return the path of a pseudo-terminal."""
        return str(self.folder / name)


@pytest.fixture(scope="module")
def wires(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Wires]:
    folder = tmp_path_factory.mktemp("wires")
    (folder / "world.toml").write_text(WORLD)
    scenario, _ = write_scenario(folder)
    text = scenario.read_text().replace('world = "pool"', 'world = "world.toml"').replace("depth = 2", "depth = 0", 1)
    scenario.write_text(text + SENSORS.format(folder=folder))
    with Program(folder, "slave", scenario) as slave:
        for name in ("gps", "imu", "pressure", "dvl", "usbl"):
            slave.expect(f"{name}: .* at pty:")
        yield Wires(folder)


def listens(port: int) -> bool:
    """Return whether somebody listens at a port."""
    with socket.socket() as probe:
        return not probe.connect_ex(("127.0.0.1", port))


def reports_of_gpsd(port: int) -> Iterator[dict[str, Any]]:
    """Yield what gpsd tells a client that watches."""
    with socket.create_connection(("127.0.0.1", port), PATIENCE_S) as connection, connection.makefile("rw") as file:
        file.write('?WATCH={"enable":true,"json":true};\n')
        file.flush()
        for line in file:
            yield json.loads(line)


@pytest.mark.skipif(not shutil.which("gpsd"), reason="gpsd is not installed")
def test_gpsd_finds_a_u_blox_receiver_and_its_fix(wires: Wires) -> None:
    port = free_port()
    with start_child(["gpsd", "-N", "-n", "-S", str(port), wires.line("gps")]) as daemon:
        try:
            assert wait_for(lambda: listens(port))
            found: dict[str, dict[str, Any]] = {}
            deadline = time.monotonic() + PATIENCE_S
            for report in reports_of_gpsd(port):
                found[report["class"]] = report
                is_fixed = found.get("TPV", {}).get("mode") == 3
                is_known = "u-blox" in str(found.get("DEVICES")) + str(found.get("DEVICE"))
                if (is_fixed and is_known and "SKY" in found) or time.monotonic() > deadline:
                    break
        finally:
            daemon.terminate()
    fix = found["TPV"]
    assert (is_fixed, is_known) == (True, True), found
    assert (fix["lat"], fix["lon"]) == pytest.approx((57.7, 11.9), abs=1e-3)
    assert len(found["SKY"]["satellites"]) >= 5


def test_the_driver_of_a_vn200_reads_attitude_and_field(wires: Wires) -> None:
    with VN200(wires.line("imu"), timeout=PATIENCE_S) as unit:
        assert unit.read_model_number().startswith("VN-200")
        reading = unit.read_ypr_mag_accel_gyro()
    assert reading["accel_z"] == pytest.approx(-9.8, abs=1.0)
    assert sum(reading[f"mag_{axis}"] ** 2 for axis in "xyz") ** 0.5 == pytest.approx(0.5, abs=0.1)


def test_keller_s_driver_reads_the_pressure_at_the_surface(wires: Wires) -> None:
    driver = KellerProtocol(wires.line("pressure"), 9600, timeout=PATIENCE_S, echo=False)
    assert driver.f48(250).startswith("5.20")
    assert driver.f73(1, 1) == pytest.approx(1.01325, abs=0.05)


def test_a_dvl_pings_after_its_command_and_a_usbl_answers_a_ping(wires: Wires) -> None:
    with serial.Serial(wires.line("dvl"), 115_200, timeout=PATIENCE_S) as line:
        line.write(b"===")
        line.read_until(b">")
        line.write(b"EX10111\r")
        line.read_until(b">")
        line.write(b"CS\r")
        line.read_until(b"\x7f\x7f")
        size = line.read(2)
        data = b"\x7f\x7f" + size + line.read(int.from_bytes(size, "little") - 2)
        pd0_parser.validate_checksum(data, int.from_bytes(size, "little"))
        line.write(b"===")
    with serial.Serial(wires.line("x150"), 115_200, timeout=PATIENCE_S) as line:
        line.write(b"#4001040000\r\n")  # a wrong checksum
        line.write(b"#4001040187\r\n")
        while not (reply := line.readline()).startswith((b"$42", b"$43")):
            assert reply
    payload = bytes.fromhex(reply[1:].decode())
    assert payload[0] == 0x42
    assert 10 < unpack_from("<H", payload, 1 + 16 + 8)[0] < 200  # dm: the station is at the world's origin


def test_a_client_changes_the_speed_of_a_line_and_reads_rubbish_until_it_follows(wires: Wires) -> None:
    with serial.Serial(wires.line("imu"), 115_200, timeout=PATIENCE_S) as line:

        def is_readable(baud: int) -> bool:
            line.baudrate = baud
            line.reset_input_buffer()
            return b"$VN" in line.read(1200)[-300:]  # the first may have come before the change

        assert [is_readable(baud) for baud in (115_200, 57_600, 115_200)] == [True, False, True]
        line.write(b"$VNWRG,05,9600*XX\r\n")
        assert line.read_until(b"$VNWRG,05,9600*")
        assert [is_readable(baud) for baud in (115_200, 9600)] == [False, True]
        began = time.monotonic()
        line.read(3200)
        assert time.monotonic() - began > 0.9  # without the 2 kB that may have waited; at 115,200 bit/s 0.7 s
        line.write(b"$VNWRG,05,115200*XX\r\n")
        assert line.read_until(b"$VNWRG,05,115200*")
        assert is_readable(115_200)
