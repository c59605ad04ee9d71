"""HIL messages for PX4: units, masks, omitted fields; controls as pulse widths; and a recorded flight."""

import itertools
from math import inf, nan

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.autopilots.hil_messages import (
    ARMED,
    LOCKSTEP,
    compute_pressure_altitude,
    controls_to_pwm,
    encode_gps,
    encode_odometry,
    encode_sensor,
    encode_truth,
)
from hil.links.contract import Counters
from hil.links.mavlink.stream import MavlinkStream
from sim.sensors.extra_samples import FixSample
from sim.sensors.samples import OdometrySample
from tests.support.autopilots.captured import needs_captures, rows


def test_hil_sensor_has_units_gauss_and_hectopascal() -> None:
    message = encode_sensor(5_000_000, (0.1, 0.2, -9.8), (0.01, 0.02, 0.03), (2e-5, 0.0, 4.4e-5), 151_325.0)
    assert (message.time_usec, message.zacc, message.ygyro) == (5_000_000, -9.8, 0.02)
    assert (message.xmag, message.zmag) == pytest.approx((0.2, 0.44))
    assert message.abs_pressure == pytest.approx(1513.25)
    assert message.fields_updated == 0x007 | 0x038 | 0x1C0 | 0x1A00


def test_unmeasured_fields_are_not_marked_as_updated() -> None:
    assert encode_sensor(1, None, None, None, None).fields_updated == 0
    assert encode_sensor(1, (0.0,) * 3, (0.0,) * 3, None, None).fields_updated == 0x03F
    assert encode_sensor(1, None, None, None, 1e5).fields_updated == 0x1A00


def test_pressure_altitude_is_that_of_the_standard_atmosphere() -> None:
    assert compute_pressure_altitude(1013.25) == 0.0
    assert compute_pressure_altitude(898.745) == pytest.approx(1000.0, abs=1.0)  # standard atmosphere, ISO 2533


def test_hil_gps_reports_fix_and_no_fix() -> None:
    fix = FixSample(0, 50.1234567, -8.5, 12.3, (4.0, 9.0), True)
    message = encode_gps(7, fix, (1.0, -1.0, 0.25))
    assert (message.fix_type, message.lat, message.lon, message.alt) == (3, 501_234_567, -85_000_000, 12_300)
    assert (message.eph, message.epv) == (200, 300)  # cm, as PX4 reads them
    assert (message.vel, message.vn, message.ve, message.vd, message.cog) == (141, 100, -100, 25, 31_500)
    lost = encode_gps(7, FixSample(0, nan, nan, nan, (4.0, 9.0), False), (1.0, 0.0, 0.0))
    assert (lost.fix_type, lost.lat, lost.satellites_visible) == (0, 0, 0)


def test_odometry_has_the_frames_that_px4_accepts() -> None:
    sample = OdometrySample(0, (1.0, 2.0, 3.0), (1.0, 0.0, 0.0, 0.0), (0.1, 0.2, 0.3, 0.01, 0.02, 0.03))
    message = encode_odometry(9, sample, (1.0, 0.25, 0.01, 0.04, 0.0))
    assert [message.pose_covariance[i] for i in (0, 6, 11, 20)] == [1.0, 1.0, 0.25, 0.01]
    assert [message.velocity_covariance[i] for i in (0, 11, 20)] == [0.04, 0.04, 0.0]
    assert (message.frame_id, message.child_frame_id, message.estimator_type, message.quality) == (1, 12, 2, 100)
    assert (message.x, message.y, message.z, message.vz, message.yawspeed) == (1.0, 2.0, 3.0, 0.3, 0.03)
    assert [i for i, x in enumerate(message.pose_covariance) if x] == [0, 6, 11, 15, 18, 20]


def test_every_message_can_be_packed() -> None:
    stream, counters = MavlinkStream(1, 200, Counters()), Counters()
    sample = OdometrySample(0, (1.0, 2.0, 3.0), (1.0, 0.0, 0.0, 0.0), (0.1,) * 6)
    huge = encode_truth(1, sample, (1e6, 0.0, 0.0), (1e6, 0.0, 0.0), (50.0, 8.0, -3.0))
    data = b"".join(
        map(
            stream.pack,
            [
                encode_odometry(1, sample, (0.0,) * 5),
                huge,
                encode_sensor(1, None, None, None, 1e5),
            ],
        )
    )
    found = MavlinkStream(255, 1, counters).unpack(data)
    assert [m.get_type() for m in found] == ["ODOMETRY", "HIL_STATE_QUATERNION", "HIL_SENSOR"]


def test_controls_become_pulse_widths() -> None:
    assert controls_to_pwm((0.0, 1.0, -1.0, 0.25, 2.0, nan, -inf)) == (1500, 1900, 1100, 1600, 1900, 0, 0)


@needs_captures
@pytest.mark.parametrize("airframe", ["1021", "1022"])
def test_a_recorded_flight_is_decoded_completely(airframe: str) -> None:
    """All messages of both directions decode; nothing is output before arming; thrusts equal the recorded ones."""
    counters = Counters()
    streams = {way: MavlinkStream(255, 1, counters) for way in ("ap>sim", "sim>ap")}
    actuators, sensors = [], 0
    for row in rows(f"px4_{airframe}_hil"):
        for message in streams[row.direction].unpack(row.data):
            if message.get_type() == "HIL_ACTUATOR_CONTROLS":
                actuators.append(message)
            sensors += message.get_type() == "HIL_SENSOR"
    assert counters.checksum_errors == 0
    assert sensors > 4000
    assert len(actuators) > 3000
    assert all(message.flags & LOCKSTEP for message in actuators)
    disarmed = [controls_to_pwm(m.controls) for m in actuators if not m.mode & ARMED]
    assert disarmed
    assert {pulse for pulses in disarmed for pulse in pulses} == {1500}
    armed = [controls_to_pwm(m.controls) for m in actuators if m.mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED]
    assert any(pulses[:4] != (1500,) * 4 for pulses in armed)
    steps = {later.time_usec - sooner.time_usec for sooner, later in itertools.pairwise(actuators)}
    assert steps == {4000}
