"""A real slave's MAVLink vehicle answers all that QGroundControl requires when it connects."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.common.ports import free_ports
from hil.gateways.mavlink.flight.modes import Mode
from tests.support.clients.mavlink_ground import Ground
from tests.support.clients.qgroundcontrol import Station
from tests.support.processes import Program, free_port, write_scenario

LAYOUT = '[mavlink]\nendpoints = ["udpin:127.0.0.1:{udp}"]\nparameters = "{file}"\nautopilot = "{autopilot}"\n'


@pytest.fixture(scope="module", params=["ardupilot", "generic"])
def station(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Station]:
    folder, udp = tmp_path_factory.mktemp("vehicle"), free_port()
    scenario, _ = write_scenario(folder)
    scenario.write_text(scenario.read_text().replace("paper_six", "bluerov2_heavy_t200"))
    layout = LAYOUT.format(udp=udp, file=folder / "parameters.toml", autopilot=request.param)
    scenario.write_text(scenario.read_text() + layout)
    with Program(folder, "slave", scenario) as slave:
        slave.expect("MAVLink system 1 is uuv1")
        station = Station(f"udpout:127.0.0.1:{udp}")
        station.beat()
        station.connect()
        yield station
        station.link.close()


def test_each_request_of_its_connection_is_answered(station: Station) -> None:
    station.start_streams()
    capabilities = station.version().capabilities
    assert capabilities & dialect.MAV_PROTOCOL_CAPABILITY_FTP
    assert capabilities & dialect.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST
    station.plan(dialect.MAV_MISSION_TYPE_MISSION)
    # It asks for fences and rally points where they are announced, or the version never came.
    assert not station.plan(dialect.MAV_MISSION_TYPE_FENCE)
    assert not station.plan(dialect.MAV_MISSION_TYPE_RALLY)


def test_speeds_and_currents_of_the_motors_are_sent(station: Station) -> None:
    """Motors with a manufacturer's table are reported in both messages that it reads, for all eight."""
    station.set_mode(Mode.MANUAL)
    assert station.command_to(1, dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1, 0) == 0

    def push() -> None:
        station.sticks(x=800, z=300)

    for kind in ("ESC_TELEMETRY_1_TO_4", "ESC_TELEMETRY_5_TO_8"):
        turning = station.wait(kind, lambda escs: min(escs.rpm) > 0, push)
        assert min(turning.current) > 0
        assert max(turning.rpm) < 4000
    station.disarm()


def test_its_motors_page_turns_one_thruster(station: Station) -> None:
    assert station.command_to(1, dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1, 0) == 0

    def slide() -> None:
        assert station.command_to(1, dialect.MAV_CMD_DO_MOTOR_TEST, 2, 0, 70, 0, 0, 2) == 0

    def turns_one(servos: Any) -> bool:
        return len([pulse for pulse in _pulses(servos) if pulse != 1500]) == 1

    station.wait("SERVO_OUTPUT_RAW", turns_one, slide)
    station.disarm()


def _pulses(servos: Any) -> list[int]:
    return [getattr(servos, f"servo{number}_raw") for number in range(1, 9)]


def test_beside_an_autopilot_the_vehicle_is_shown_and_not_armed(tmp_path: Path) -> None:
    udp, (autopilot,) = free_port(), free_ports(1)
    top = f'controller = "ardupilot"\n[autopilot]\naddress = "udp://127.0.0.1:{autopilot}"\n'
    scenario, _ = write_scenario(tmp_path, top=top)
    text = scenario.read_text().replace("paper_six", "bluerov2_heavy")
    layout = LAYOUT.format(udp=udp, file=tmp_path / "parameters.toml", autopilot="ardupilot")
    scenario.write_text(text + layout)
    with Program(tmp_path, "slave", scenario) as slave:
        slave.expect("MAVLink system 2 is uuv1")
        ground = Ground(f"udpout:127.0.0.1:{udp}")
        assert ground.connect().get_srcSystem() == 2
        ground.send.command_long_send(2, 1, dialect.MAV_CMD_COMPONENT_ARM_DISARM, 0, 1, 0, 0, 0, 0, 0, 0)
        assert ground.wait("COMMAND_ACK").result == dialect.MAV_RESULT_FAILED
        assert "is flown by" in ground.wait("STATUSTEXT", lambda text: "flown" in text.text).text
        ground.link.close()
