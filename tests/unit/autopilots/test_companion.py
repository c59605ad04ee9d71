"""Positions for ArduSub: which sensor gives which message, units, the origin until it is confirmed, reconnection."""

import socket
import struct
from collections.abc import Callable, Iterator
from functools import partial
from math import nan, tau
from pathlib import Path
from types import MappingProxyType
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.autopilots.companion import Companion, encode_gps_input, encode_position_delta
from hil.autopilots.frames import map_motors
from hil.autopilots.inputs import SensorInputs
from hil.autopilots.parameter_reader import ParameterReader
from hil.autopilots.parameters import Parameters, all_parameters
from hil.common.errors import ConfigError
from hil.links.contract import Counters
from hil.links.mavlink.stream import MavlinkStream
from hil.scenario.autopilot_records import AutopilotSettings
from hil.scenario.config import Scenario, load_scenario
from sim.environment.world import load_world
from sim.sensors.extra_samples import FixSample, FlagSample
from sim.sensors.samples import DvlSample, OdometrySample, PressureSample
from sim.vehicle.vehicle import load_vehicle
from tests.support.processes import wait_for

SCENARIO = """
vehicle = "bluerov2"
world = "open_water"
controller = "{controller}"
master = {{}}
[start]
depth = 0
[autopilot]
positions = "{positions}"
[sensors.imu]
rate = 400
[sensors.dvl]
rate = 8
orientation = [0, 0, 1.5707963267948966]
{sensors}
"""
TRUTH = OdometrySample(0, (1.0, 2.0, 3.0), (1.0, 0.0, 0.0, 0.0), (0.1, 0.2, 0.3, 0.01, 0.02, 0.03))
SECOND = 1_000_000_000


def scenario_of(folder: Path, positions: str, controller: str = "ardupilot", sensors: str = "") -> Scenario:
    path = folder / "positions.toml"
    path.write_text(SCENARIO.format(positions=positions, controller=controller, sensors=sensors))
    return load_scenario(str(path))


class Bench:
    """A companion and the port that it connects to, in one thread."""

    def __init__(self, folder: Path, positions: str, expected: Parameters = MappingProxyType({})) -> None:
        scenario = scenario_of(folder, positions, sensors="[sensors.gps]")
        self.inputs = SensorInputs(scenario, load_world(scenario.world))
        self.listener = socket.create_server(("127.0.0.1", 0))
        port = self.listener.getsockname()[1]
        self.reports: list[str] = []
        self.reader = ParameterReader("ardupilot", expected, "use --defaults", self.reports.append)
        self.companion = Companion(positions, self.inputs, (50.0, 8.0), port, self.reports.append, self.reader)
        self.peer: socket.socket | None = None
        self.stream = MavlinkStream(1, 1, Counters())

    def messages(self, time_ns: int) -> list[Any]:
        """Advance to this time; return the messages that the autopilot then gets."""
        self.companion.advance(time_ns, TRUTH, "127.0.0.1")
        if self.peer is None:
            self.peer, _ = self.listener.accept()
            self.peer.setblocking(False)
        try:
            return self.stream.unpack(self.peer.recv(4096))
        except BlockingIOError:
            return []

    def close(self) -> None:
        self.companion.close()
        self.listener.close()
        if self.peer:
            self.peer.close()


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Callable[[str], Bench]]:
    benches: list[Bench] = []

    def make(positions: str) -> Bench:
        benches.append(Bench(tmp_path, positions))
        return benches[-1]

    yield make
    for one in benches:
        one.close()


def names(messages: list[Any]) -> list[str]:
    return [message.get_type() for message in messages]


def test_the_origin_is_sent_until_the_autopilot_confirms_it(bench: Callable[[str], Bench]) -> None:
    b = bench("odometry")
    beat, origin, *_ = b.messages(0)
    assert (beat.get_type(), beat.type) == ("HEARTBEAT", dialect.MAV_TYPE_ONBOARD_CONTROLLER)
    assert (origin.latitude, origin.longitude, origin.altitude) == (500_000_000, 80_000_000, 0)
    assert names(b.messages(SECOND))[:2] == ["HEARTBEAT", "SET_GPS_GLOBAL_ORIGIN"]
    assert b.peer
    b.peer.sendall(b.stream.pack(dialect.MAVLink_gps_global_origin_message(500_000_000, 80_000_000, 0)))
    b.messages(2 * SECOND)
    assert "SET_GPS_GLOBAL_ORIGIN" not in names(b.messages(3 * SECOND))
    assert b.reports == [f"sending positions (odometry) to ArduPilot's port {b.listener.getsockname()[1]}"]


def test_odometry_is_sent_once_a_sample(bench: Callable[[str], Bench]) -> None:
    b = bench("odometry")
    b.messages(0)
    b.inputs.update("odom", TRUTH)
    (message,) = b.messages(50_000_000)
    assert (message.frame_id, message.child_frame_id, message.time_usec) == (20, 12, 50_000)  # what ArduPilot reads
    assert (message.x, message.y, message.z, message.vx) == (1.0, 2.0, 3.0, pytest.approx(0.1))
    assert b.messages(60_000_000) == []


def test_dvl_deltas_are_between_successive_samples_with_bottom_lock(bench: Callable[[str], Bench]) -> None:
    b = bench("dvl")
    b.messages(0)

    def sample(time_ns: int, locked: bool = True) -> list[str]:
        b.inputs.update("dvl", DvlSample(time_ns, (0.4, 0.0, 0.0) if locked else (nan,) * 3, 5.0, locked))
        return names(b.messages(time_ns))

    assert sample(100_000_000) == []  # there is no earlier sample
    assert sample(200_000_000) == ["VISION_POSITION_DELTA"]
    assert b.inputs.dvl.velocity == pytest.approx((0.0, 0.4, 0.0))  # its axes are turned to the right
    assert sample(300_000_000, locked=False) == []
    assert sample(400_000_000) == []
    assert sample(500_000_000) == ["VISION_POSITION_DELTA"]
    assert sample(990_000_000) == ["VISION_POSITION_DELTA"]
    assert sample(1_600_000_000)[:1] == ["HEARTBEAT"]  # 0.61 s later: no neighbour


def test_a_position_delta_is_velocity_and_rate_times_its_duration() -> None:
    message = encode_position_delta(7, DvlSample(0, (0.4, -0.2, 0.1), 5.0, True), (0.1, 0.0, -0.2), 125_000_000)
    assert (message.time_usec, message.time_delta_usec, message.confidence) == (7, 125_000, 100.0)
    assert message.position_delta == pytest.approx([0.05, -0.025, 0.0125])
    assert message.angle_delta == pytest.approx([0.0125, 0.0, -0.025])


def test_gps_input_reports_fix_and_lost_fix(bench: Callable[[str], Bench]) -> None:
    fix = FixSample(0, 50.1234567, -8.5, 12.3, (4.0, 9.0), True)
    message = encode_gps_input(7, fix, (1.0, -1.0, 0.25))
    assert (message.fix_type, message.lat, message.lon, message.alt) == (3, 501_234_567, -85_000_000, 12.3)
    assert (message.vn, message.ve, message.vd) == (1.0, -1.0, 0.25)
    assert (message.horiz_accuracy, message.vert_accuracy) == (2.0, 3.0)
    b = bench("gps")
    b.messages(0)
    b.inputs.update("gps", FixSample(0, nan, nan, nan, (4.0, 9.0), False))
    (lost,) = b.messages(1)
    assert (lost.get_type(), lost.fix_type, lost.satellites_visible) == ("GPS_INPUT", 1, 0)


def test_a_leak_is_reported_once_a_second_as_an_unhealthy_water_sensor(bench: Callable[[str], Bench]) -> None:
    b = bench("simulated")
    b.messages(0)
    assert "SYS_STATUS" not in names(b.messages(SECOND))
    b.inputs.update("leak", FlagSample(SECOND, True))
    reported = [message for step in range(4, 8) for message in b.messages(step * SECOND // 2)]
    statuses = [message for message in reported if message.get_type() == "SYS_STATUS"]
    water = 0x20000000
    assert [m.onboard_control_sensors_enabled & ~m.onboard_control_sensors_health for m in statuses] == [water, water]


def test_faults_of_sensors_that_ardusub_simulates_are_set_in_it_when_they_begin_and_end(
    bench: Callable[[str], Bench],
) -> None:
    """The scenario has a pressure sensor, by default, and a GPS; the latter's fix ends under water."""

    def settings(time_ns: int, has_fix: bool) -> dict[str, float]:
        b.inputs.update("pressure", PressureSample(min(time_ns, 4 * SECOND), 101_325.0))
        b.inputs.update("gps", FixSample(time_ns, 50.0, 8.0, 0.0, (4.0, 9.0), has_fix))
        b.inputs.expire(time_ns)
        return {m.param_id: m.param_value for m in b.messages(time_ns) if m.get_type() == "PARAM_SET"}

    b = bench("simulated")
    b.messages(0)
    assert b.peer
    b.peer.sendall(b.stream.pack(dialect.MAVLink_heartbeat_message(12, 3, 0, 0, 4, 3)))
    b.messages(1)
    sound = {"SIM_BARO_DISABLE": 0.0, "SIM_BAR2_DISABLE": 0.0, "SIM_GPS1_ENABLE": 1.0, "SIM_GPS_DISABLE": 0.0}
    assert settings(SECOND, True) == sound
    assert settings(2 * SECOND, True) == {}
    assert settings(3 * SECOND, False) == {"SIM_GPS1_ENABLE": 0.0, "SIM_GPS_DISABLE": 1.0}
    assert settings(4 * SECOND, True) == {"SIM_GPS1_ENABLE": 1.0, "SIM_GPS_DISABLE": 0.0}
    assert settings(5 * SECOND, True) == {"SIM_BARO_DISABLE": 1.0, "SIM_BAR2_DISABLE": 1.0}


def test_parameters_of_a_px4_are_the_bytes_of_integers_and_followed(tmp_path: Path) -> None:
    reports: list[str] = []
    followed: list[tuple[str, float]] = []
    reader = ParameterReader("px4", {"CA_ROTOR_COUNT": 8, "UUV_MGM_YAW": 0.3}, "load them", reports.append)
    reader.follow(["PWM_MAIN_FUNC13", "UUV_MGM_YAW"], lambda *value: followed.append(value))
    assert [m.param_id for m in reader.requests(1, True)] == ["CA_ROTOR_COUNT", "UUV_MGM_YAW", "PWM_MAIN_FUNC13"]
    (count,) = struct.unpack("<f", struct.pack("<i", 6))
    for _ in range(2):  # what a ground station sets later is followed, not reported
        reader.take(dialect.MAVLink_param_value_message(b"CA_ROTOR_COUNT", count, 6, 1, 0))
        reader.take(dialect.MAVLink_param_value_message(b"UUV_MGM_YAW", 0.30000001, 9, 1, 0))
        reader.requests(1, True)
    assert reports == ["PX4: its parameters are not those of this scenario: CA_ROTOR_COUNT is 6, not 8: load them"]
    assert followed[0] == ("CA_ROTOR_COUNT", 6)
    assert len(followed) == 4


def test_parameters_of_an_autopilot_started_by_hand_that_differ_are_reported(tmp_path: Path) -> None:
    b = Bench(tmp_path, "simulated", {"FRAME_CONFIG": 2.0, "INS_GYR_CAL": 1.0})
    b.messages(0)
    for second in range(1, 32):
        b.messages(second * SECOND)
    assert "sends nothing" in b.reports.pop()
    assert b.peer
    for name, value in ((b"FRAME_CONFIG", 1.0), (b"INS_GYR_CAL", 1.0)):
        b.peer.sendall(b.stream.pack(dialect.MAVLink_param_value_message(name, value, 9, 2, 0)))
    for second in range(32, 36):
        b.messages(second * SECOND)
    (report,) = b.reports
    assert "FRAME_CONFIG is 1, not 2: use --defaults" in report
    b.close()


def test_the_companion_reconnects_after_a_restart_of_the_autopilot(bench: Callable[[str], Bench]) -> None:
    b = bench("odometry")
    b.messages(0)
    assert b.peer
    b.peer.close()
    b.peer = None
    for second in (1, 2, 3):  # until the end of the connection is detected
        b.companion.advance(second * SECOND, TRUTH, "127.0.0.1")
    assert "SET_GPS_GLOBAL_ORIGIN" in names(b.messages(0))


def is_off_by(b: Bench, error: float) -> bool:
    b.messages(SECOND)
    estimate = b.companion.estimate
    return estimate is not None and abs(estimate.position - error) < 0.1


def test_the_estimate_is_compared_with_the_truth_and_an_absurd_altitude_reported(bench: Callable[[str], Bench]) -> None:
    b = bench("simulated")
    assert names(b.messages(0)) == ["HEARTBEAT", "COMMAND_LONG", "COMMAND_LONG"]  # no origin: it has its own GPS
    assert b.peer
    where = dialect.MAVLink_global_position_int_message
    for altitude, error in ((-3000, 2.236), (583_900, 586.9)):
        attitude = dialect.MAVLink_attitude_message(0, 0.1, 0.0, 6.2, 0, 0, 0)
        position = where(0, 500_000_000, 80_000_000, altitude, 0, 0, 0, 0, 0)
        b.peer.sendall(b.stream.pack(attitude) + b.stream.pack(position))
        assert wait_for(partial(is_off_by, b, error))
        assert b.companion.estimate
        assert b.companion.estimate[:3] == pytest.approx((0.1, 0.0, 6.2 - tau), abs=1e-6)
        assert len(b.reports) == (altitude > 0)
    assert "at an altitude of 583.9 m: start it with the --home" in b.reports[0]


def test_a_receiver_measures_the_velocity_of_its_antenna(tmp_path: Path) -> None:
    """A mast of 0.4 m on a vehicle whose starboard side goes down moves to starboard."""
    scenario = scenario_of(tmp_path, "gps", sensors="[sensors.gps]\nposition = [0, 0, -0.4]")
    inputs = SensorInputs(scenario, load_world(scenario.world))
    truth = TRUTH._replace(orientation=(1.0, 0.0, 0.0, 0.0), nu=(0.5, 0.0, 0.0, 0.25, 0.0, 0.0))
    assert inputs.antenna_velocity(truth) == pytest.approx((0.5, 0.1, 0.0))


def test_ardusub_parameters_select_the_position_source(tmp_path: Path) -> None:
    vehicle, _ = load_vehicle("bluerov2_heavy")
    motors = map_motors("auto", vehicle)
    parameters = {
        positions: all_parameters(AutopilotSettings(positions=positions), "ardupilot", vehicle, motors)
        for positions in ("simulated", "odometry", "dvl", "gps")
    }
    assert "SIM_GPS1_ENABLE" not in parameters["simulated"]
    assert all(parameters[name]["SIM_GPS1_ENABLE"] == 0 for name in ("odometry", "dvl", "gps"))
    assert parameters["dvl"]["EK3_SRC1_POSXY"] == parameters["odometry"]["EK3_SRC1_VELXY"] == 6
    assert parameters["gps"]["GPS1_TYPE"] == 14


def test_positions_need_their_sensor(tmp_path: Path) -> None:
    for controller in ("ardupilot", "px4"):
        with pytest.raises(ConfigError, match=r"positions: 'gps' needs that sensor: add \[sensors.gps\]"):
            scenario_of(tmp_path, "gps", controller)
