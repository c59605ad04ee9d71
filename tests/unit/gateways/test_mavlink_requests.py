"""What scripts and ground stations of BlueROV2 users send, and what it means to the vehicle: a row a request."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.gateways.mavlink.snapshot import Echo
from sim.sensors.extra_samples import BatterySample
from tests.support.clients.mavlink_vehicle import Bench

ACCEPTED, UNSUPPORTED = dialect.MAV_RESULT_ACCEPTED, dialect.MAV_RESULT_UNSUPPORTED

MESSAGES = {  # message -> fields, by MAVLink's units
    "RAW_IMU": {"xgyro": 100, "zgyro": -200, "zacc": -1000, "xmag": 200, "zmag": 400},
    "SCALED_IMU": {"xgyro": 100, "zacc": -1000, "zmag": 400},
    "SCALED_IMU2": {"zgyro": -200},
    "SCALED_IMU3": {"xmag": 200},
    "HIGHRES_IMU": {"zacc": -9.80665, "zmag": 0.4, "abs_pressure": 1213.25, "fields_updated": 0x3FF},
    "SCALED_PRESSURE": {"press_abs": 1213.25},
    "SCALED_PRESSURE2": {"press_abs": 1213.25},
    "AHRS": {"error_rp": 0.0},
    "AHRS2": {"altitude": -2.0, "lat": 450000000, "lng": 100000000},
    "ODOMETRY": {"z": 2.0, "frame_id": dialect.MAV_FRAME_LOCAL_NED, "child_frame_id": dialect.MAV_FRAME_BODY_FRD},
    "ALTITUDE": {"altitude_local": -2.0, "altitude_relative": -2.0, "bottom_clearance": 8.0},
    "RANGEFINDER": {"distance": 8.0},
    "DISTANCE_SENSOR": {"current_distance": 800},
    "VIBRATION": {"clipping_0": 0},
    "POWER_STATUS": {"flags": dialect.MAV_POWER_STATUS_BRICK_VALID},
    "GPS_GLOBAL_ORIGIN": {"latitude": 450000000, "longitude": 100000000},
}


@pytest.mark.parametrize("name", MESSAGES)
def test_messages_of_the_sensors_are_sent_when_they_are_requested(name: str) -> None:
    bench = Bench()
    bench.vehicle.echo = Echo(8.0, 0.3, 50.0)
    bench.vehicle.battery = BatterySample(0, 15.0, 2.0, 9.0, 10.0, False)
    bench.run(0.1)
    bench.partner.received.clear()
    number = getattr(dialect, f"MAVLINK_MSG_ID_{name}")
    assert bench.partner.command(dialect.MAV_CMD_REQUEST_MESSAGE, number) == ACCEPTED
    (message,) = bench.partner.take_messages(name)
    values = {field: getattr(message, field) for field in MESSAGES[name]}
    assert values == pytest.approx(MESSAGES[name], rel=1e-5)


def test_what_is_not_measured_is_not_sent() -> None:
    bench = Bench()
    for name in ("RANGEFINDER", "DISTANCE_SENSOR", "BATTERY_STATUS"):
        number = getattr(dialect, f"MAVLINK_MSG_ID_{name}")
        assert bench.partner.command(dialect.MAV_CMD_REQUEST_MESSAGE, number) == UNSUPPORTED
    bench.run(1.0)
    (status, *_) = bench.partner.take_messages("SYS_STATUS")
    assert (status.voltage_battery, status.current_battery, status.battery_remaining) == (0, -1, -1)
    bench.vehicle.echo = Echo(float("nan"), 0.3, 50.0)  # no echo: beyond the reach, not the last one
    bench.run(1.0)
    assert bench.partner.take_messages("RANGEFINDER") == []
    assert bench.partner.take_messages("DISTANCE_SENSOR")[-1].current_distance == 5001
