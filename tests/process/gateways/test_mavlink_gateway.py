"""A real slave as a MAVLink vehicle, with pymavlink as its ground station: over UDP, TCP, a pty, and by a scenario."""

import itertools
import os
import time
import tty
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink import mavparm
from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.gateways.mavlink.flight.modes import Mode
from tests.support.clients.mavlink_ground import Ground
from tests.support.processes import PATIENCE_S, Program, free_port, wait_for, write_scenario

LAYOUT = (
    '[mavlink]\nendpoints = ["udpin:127.0.0.1:{udp}", "tcpin:127.0.0.1:{tcp}"]\nparameters = "{file}"\nlogs = "{logs}"'
)


class Vehicle:
    """The ports of a slave with a MAVLink vehicle beside it."""

    def __init__(self, slave: Program, udp: int, tcp: int, port: int, scenario: Path) -> None:
        self.slave, self.udp, self.tcp, self.port, self.scenario = slave, udp, tcp, port, scenario


@pytest.fixture(scope="module")
def vehicle(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Vehicle]:
    folder = tmp_path_factory.mktemp("vehicle")
    (folder / "logs").mkdir()
    (folder / "logs" / "run.mcap").write_bytes(bytes(range(256)) * 20)
    udp, tcp = free_port(), free_port()
    layout = LAYOUT.format(udp=udp, tcp=tcp, file=folder / "parameters.toml", logs=folder / "logs")
    scenario, port = write_scenario(folder, top="", slave="", link="")
    scenario.write_text(scenario.read_text() + layout)
    with Program(folder, "slave", scenario) as slave:
        slave.expect("MAVLink system 1 is uuv1")
        yield Vehicle(slave, udp, tcp, port, scenario)


@pytest.fixture
def ground(vehicle: Vehicle) -> Iterator[Ground]:
    ground = Ground(f"udpout:127.0.0.1:{vehicle.udp}")
    ground.beat()
    ground.connect()
    yield ground
    ground.disarm()
    ground.link.close()


def test_parameters_are_read_and_set(ground: Ground) -> None:
    # The slave's parameters come a little after the vehicle, and a busy slave's only with the next query.
    is_gain, ask = (lambda value: value.param_id == "HIL_G_SURGE_P"), ground.send.param_request_read_send
    ground.wait("PARAM_VALUE", is_gain, lambda: ask(1, 1, b"HIL_G_SURGE_P", -1))
    names: set[str] = set()
    tries = itertools.count()

    def is_last(value: Any) -> bool:
        names.add(value.param_id)
        return bool(len(names) == value.param_count)

    # Again after a while: the socket of a busy station drops datagrams.
    count = ground.wait("PARAM_VALUE", is_last, lambda: next(tries) % 200 or ground.send.param_request_list_send(1, 1))
    assert count.param_count > 60
    assert {"WPNAV_SPEED", "HIL_G_SURGE_P"} <= names
    parameters = mavparm.MAVParmDict()
    changes = {"WPNAV_SPEED": 80.0, "HIL_G_SURGE_P": 3.5, "ATC_ANG_YAW_P": 1.5}
    for name, value in changes.items():
        assert parameters.mavset(ground.link, name, value, retries=10, parm_type=None)
    assert parameters.mavset(ground.link, "WPNAV_SPEED", 50.0, retries=10)


def test_pulse_widths_are_sent_more_often_than_once_a_second(ground: Ground) -> None:
    """The joystick moves to and fro. The slave's diagnostics, which hold the widths too, are sent once a second."""
    ground.set_mode(Mode.MANUAL)
    ground.arm()
    assert ground.command(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, dialect.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW, 1e5) == 0
    pulses: list[int] = []
    began_ms = ground.wait("SYSTEM_TIME").time_boot_ms

    def changes(message: Any) -> bool:
        if message.servo1_raw not in pulses[-1:]:
            pulses.append(message.servo1_raw)
        return len(pulses) > 12

    ground.wait("SERVO_OUTPUT_RAW", changes, lambda: ground.sticks(x=300 if int(5 * time.monotonic()) % 2 else -300))
    assert ground.wait("SYSTEM_TIME").time_boot_ms - began_ms < 10_000, "of the vehicle's time"
    assert any(pulse not in (0, 1500) for pulse in pulses)


def test_a_joystick_moves_the_vehicle_and_silence_stops_it(ground: Ground) -> None:
    ground.set_mode(Mode.ALT_HOLD)
    ground.arm()
    start = ground.read_position()
    ground.wait("VFR_HUD", lambda hud: hud.groundspeed > 0.15, lambda: ground.sticks(x=600))
    ground.wait("STATUSTEXT", lambda text: "joystick silent" in text.text)
    ground.wait("VFR_HUD", lambda hud: hud.groundspeed < 0.05)
    assert abs(ground.read_position().z - start.z) < 0.3
    ground.set_mode(Mode.MANUAL)
    before = ground.wait("ATTITUDE").yaw
    ground.wait("ATTITUDE", lambda a: abs(a.yaw - before) > 0.2, lambda: ground.sticks(r=400))


def test_several_ground_stations_connect_and_a_web_page_cannot_arm(ground: Ground, vehicle: Vehicle) -> None:
    other_station = Ground(f"tcp:127.0.0.1:{vehicle.tcp}", system=254)
    other_station.beat()
    other_station.connect()
    ground.set_mode(Mode.STABILIZE)
    other_station.wait("HEARTBEAT", lambda beat: beat.custom_mode == Mode.STABILIZE)
    other_station.link.close()
    import socket

    with socket.create_connection(("127.0.0.1", vehicle.tcp)) as page:
        arm = dialect.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
        page.sendall(b"POST / HTTP/1.1\r\nHost: x\r\n\r\n" + arm.pack(dialect.MAVLink(None, 255, 190)))
        page.settimeout(PATIENCE_S)
        assert wait_for(lambda: not page.recv(4096) or None, PATIENCE_S)
    assert not ground.connect().base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED


def test_a_second_mavlink_gateway_on_a_serial_line_cannot_command(
    ground: Ground, vehicle: Vehicle, tmp_path: Path
) -> None:
    """A second gateway serves a pty; only the gateway that armed first may command."""
    radio, line = os.openpty()
    tty.setraw(line)  # what is written before the gateway opens it is no text of a person
    device = os.ttyname(line)
    options = ("--connect", f"tcp/127.0.0.1:{vehicle.port}", "--endpoint", f"serial:{device}:115200")
    own = {"XDG_STATE_HOME": str(tmp_path)}
    with Program(tmp_path, "gateway", "mavlink", *options, environment=own) as second:
        second.expect("MAVLink system 1")
        ground.set_mode(Mode.ALT_HOLD)
        ground.arm()
        parser = dialect.MAVLink(None, 255, 190)
        parser.robust_parsing = True
        os.set_blocking(radio, False)

        def acknowledgements() -> list[Any]:
            """Keep the first armed, and return what the second has answered since."""
            ground.beat()
            ground.sticks()
            while ground.link.recv_match(blocking=False):
                pass
            time.sleep(0.2)  # the slave reports once a second who commands it
            try:
                messages = parser.parse_buffer(os.read(radio, 4096)) or []
            except BlockingIOError:
                messages = []
            return [message.result for message in messages if message.get_type() == "COMMAND_ACK"]

        def ask(arm: int) -> None:
            message = dialect.MAVLink_command_long_message(1, 1, 400, 0, arm, 0, 0, 0, 0, 0, 0)
            os.write(radio, message.pack(parser))

        def is_refused() -> bool:
            ask(1)
            results = acknowledgements()
            if dialect.MAV_RESULT_ACCEPTED in results:  # this test was silent too long, and its vehicle was let go
                ask(0)
                for _ in range(5):
                    acknowledgements()
                ground.command(dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1)
            return dialect.MAV_RESULT_FAILED in results

        assert wait_for(is_refused)
        assert ground.connect().base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED
    os.close(radio)
    os.close(line)
