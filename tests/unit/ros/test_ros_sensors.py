"""Messages of the optional sensors: bytes of another implementation, frames, missing data."""

import json
import math
import os
import runpy
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from hil.ros import encoders as ros
from hil.ros import sensors as ros_sensors
from hil.ros.topics import TOPICS
from sim.sensors.extra_samples import (
    BatterySample,
    FieldSample,
    FixSample,
    FlagSample,
    PositionSample,
    RangeSample,
    VelocitySample,
)
from sim.sensors.kinds import SENSORS
from sim.sensors.samples import ImuSample
from tests.support.examples import examples

_VECTORS = os.path.join(os.path.dirname(__file__), "..", "..", "vectors")
with open(os.path.join(_VECTORS, "cdr_golden.json"), encoding="utf-8") as _file:
    GOLDEN = json.load(_file)["messages"]
STORE: Any = get_typestore(Stores.ROS2_JAZZY)
_build = runpy.run_path(os.path.join(_VECTORS, "make_cdr_golden.py"))["build"]

TIME_NS = 1_700_000_000_123_456_789
NUMBERS = st.floats(-1e6, 1e6)
SINGLES = st.floats(-1e6, 1e6, width=32)
VECTORS = st.tuples(NUMBERS, NUMBERS, NUMBERS)
TIMES = st.integers(0, 2**31 * 10**9 - 1)
FEW = examples(40)


def golden(type_name: str, index: int = 0) -> bytes:
    found = [message["hex"] for message in GOLDEN if message["type"] == type_name]
    return bytes.fromhex(found[index])


def encode(type_name: str, time_ns: int, frame: str, **fields: Any) -> bytes:
    """Return the bytes rosbags makes of a stamped message."""
    header = {"stamp": {"sec": time_ns // 10**9, "nanosec": time_ns % 10**9}, "frame_id": frame}
    return bytes(STORE.serialize_cdr(_build(STORE, type_name, {"header": header, **fields}), type_name))


def xyz(vector: Any) -> dict[str, float]:
    return dict(zip("xyz", vector, strict=True))


def flu(vector: Any) -> dict[str, float]:
    x, y, z = vector
    return xyz((x, -y, -z))


# --- golden bytes


@pytest.mark.parametrize(("index", "on"), [(0, True), (1, False)])
def test_flags_have_the_golden_bytes(index: int, on: bool) -> None:
    data = golden("std_msgs/msg/Bool", index)
    assert ros_sensors.encode_bool(FlagSample(TIME_NS, on)) == data
    assert ros_sensors.decode_bool(data) is on


def test_a_missing_fix_is_in_the_message() -> None:
    none = FixSample(TIME_NS, math.nan, math.nan, math.nan, (4.5, 10.25), False)
    data = golden("sensor_msgs/msg/NavSatFix", 1)
    assert ros_sensors.encode_fix(none) == data
    decoded = ros_sensors.decode_fix(data)
    assert decoded is not None
    assert not decoded.fix
    assert all(map(math.isnan, decoded[1:4]))


@pytest.mark.parametrize("distance", [math.inf, -math.inf])
def test_a_missing_or_too_close_echo_survives_a_round_trip(distance: float) -> None:
    sample = RangeSample(TIME_NS, distance, (0.5, 75.0))
    assert ros_sensors.decode_distance(ros_sensors.encode_distance(sample)) == sample


# --- random samples: our bytes are theirs, and theirs decode to the sample


@FEW
@given(TIMES, VECTORS)
def test_magnetic_fields_and_velocities_equal_those_of_rosbags(time_ns: int, vector: Any) -> None:
    field, velocity = FieldSample(time_ns, vector), VelocitySample(time_ns, vector)
    name, zero = "sensor_msgs/msg/MagneticField", {"x": 0.0, "y": 0.0, "z": 0.0}
    data = encode(name, time_ns, "magnetometer_link", magnetic_field=flu(vector), magnetic_field_covariance=[0.0] * 9)
    assert ros_sensors.encode_field(field) == data
    assert ros_sensors.decode_field(data) == field
    twist = {"linear": flu(vector), "angular": zero}
    data = encode("geometry_msgs/msg/TwistStamped", time_ns, "current_meter_link", twist=twist)
    assert ros_sensors.encode_velocity(velocity) == data
    assert ros_sensors.decode_velocity(data) == velocity


@FEW
@given(
    TIMES, st.floats(-90, 90), st.floats(-180, 180), NUMBERS, st.floats(0, 1e3), st.floats(0, 1e3), st.text(max_size=9)
)
def test_fixes_equal_those_of_rosbags(
    time_ns: int, north: float, east: float, up: float, level: float, steep: float, frame: str
) -> None:
    sample = FixSample(time_ns, north, east, up, (level, steep), True)
    frame = frame.encode(errors="replace").decode()
    data = encode(
        "sensor_msgs/msg/NavSatFix", time_ns, frame, status={"status": 0, "service": 1}, latitude=north,
        longitude=east, altitude=up, position_covariance=[level, 0.0, 0.0, 0.0, level, 0.0, 0.0, 0.0, steep],
        position_covariance_type=2,
    )  # fmt: skip
    assert ros_sensors.encode_fix(sample, frame) == data
    assert ros_sensors.decode_fix(data) == sample


@FEW
@given(TIMES, VECTORS, st.tuples(*[NUMBERS] * 6))
def test_positions_equal_those_of_rosbags(time_ns: int, position: Any, terms: Any) -> None:
    """The covariance is transformed as P C P' with the matrix P that swaps NED and ENU."""
    a, b, c, d, e, f = terms
    ned = np.array([[a, b, c], [b, d, e], [c, e, f]])
    swap = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    covariance = np.diag([0.0, 0.0, 0.0, -1.0, -1.0, -1.0])
    covariance[:3, :3] = swap @ ned @ swap.T + 0.0
    pose = {"position": xyz(swap @ position), "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}}
    data = encode(
        "geometry_msgs/msg/PoseWithCovarianceStamped",
        time_ns,
        "map",
        pose={"pose": pose, "covariance": covariance.ravel()},
    )
    sample = PositionSample(time_ns, position, tuple(ned.ravel().tolist()))
    assert ros_sensors.decode_position(data) == sample
    ours, head = ros_sensors.encode_position(sample), len(data) - 43 * 8
    assert ours[:head] == data[:head]
    assert np.array_equal(np.frombuffer(ours[head:]), np.frombuffer(data[head:]))  # but for the sign of zeros


@FEW
@given(TIMES, st.tuples(*[SINGLES] * 3), st.sampled_from([1.0, 4.0, 16.0]), st.booleans())
def test_batteries_equal_those_of_rosbags(time_ns: int, values: Any, capacity: float, off: bool) -> None:
    voltage, current, charge = values
    sample = BatterySample(time_ns, voltage, current, charge, capacity, off)
    data = encode(
        "sensor_msgs/msg/BatteryState", time_ns, "battery_link", voltage=voltage, temperature=math.nan,
        current=-current, charge=charge, capacity=capacity, design_capacity=capacity, percentage=charge / capacity,
        power_supply_status=3 if off else 2, power_supply_health=3 if off else 1, power_supply_technology=2,
        present=True, cell_voltage=[], cell_temperature=[], location="", serial_number="",
    )  # fmt: skip
    assert ros_sensors.encode_battery(sample) == data
    assert ros_sensors.decode_battery(data) == sample


def test_a_battery_message_with_cells_is_decoded() -> None:
    data = encode(
        "sensor_msgs/msg/BatteryState", TIME_NS, "b", voltage=16.0, temperature=20.0, current=-2.0, charge=1.0,
        capacity=2.0, design_capacity=2.5, percentage=0.5, power_supply_status=2, power_supply_health=1,
        power_supply_technology=3, present=True, cell_voltage=[4.0] * 4, cell_temperature=[20.0] * 3,
        location="aft", serial_number="7",
    )  # fmt: skip
    assert ros_sensors.decode_battery(data) == (TIME_NS, 16.0, 2.0, 1.0, 2.0, False)


@FEW
@given(TIMES, SINGLES, st.floats(0, 1, width=32), st.floats(1, 1000, width=32))
def test_ranges_equal_those_of_rosbags(time_ns: int, distance: float, near: float, far: float) -> None:
    sample = RangeSample(time_ns, distance, (near, far))
    data = encode(
        "sensor_msgs/msg/Range", time_ns, "altimeter_link", radiation_type=0, field_of_view=0.0, min_range=near,
        max_range=far, range=distance, variance=0.0,
    )  # fmt: skip
    assert ros_sensors.encode_distance(sample) == data
    assert ros_sensors.decode_distance(data) == sample


# --- every topic


SAMPLES = {
    "ahrs": ImuSample(TIME_NS, (1.0, 0.0, 0.0, 0.0), (0.1, 0.2, 0.3), (0.0, 0.0, -9.8)),
    "altimeter": RangeSample(TIME_NS, 7.5, (0.5, 50.0)),
    "battery": BatterySample(TIME_NS, 16.0, 2.0, 9.0, 18.0, False),
    "contact": FlagSample(TIME_NS, True),
    "current_meter": VelocitySample(TIME_NS, (0.1, 0.2, 0.3)),
    "gps": FixSample(TIME_NS, 1.0, 2.0, 3.0, (4.0, 5.0), True),
    "leak": FlagSample(TIME_NS, False),
    "magnetometer": FieldSample(TIME_NS, (1e-5, 2e-5, 3e-5)),
    "usbl": PositionSample(TIME_NS, (1.0, 2.0, 3.0), (1.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 3.0)),
}


def test_every_sensor_has_a_sample_here() -> None:
    tested_elsewhere = {"imu", "dvl", "dvl_water", "pressure", "odometry", "ground_truth"}  # test_ros and test_ros_dvl
    scans = {"laser", "profiler", "scanning_sonar", "echosounder"}  # test_ros_scans
    pictures = {"camera", "forward_sonar", "side_scan"}  # test_ros_images
    assert set(SAMPLES) == set(SENSORS) - tested_elsewhere - scans - pictures
    assert {TOPICS[name].type for name in SAMPLES} == set(ros_sensors.ENCODERS) == set(ros_sensors.DECODERS)


@pytest.mark.parametrize("prefix", ["", "uuv1/"])
@pytest.mark.parametrize("name", SAMPLES)
def test_every_sample_is_published_on_its_topic_and_decoded_again(name: str, prefix: str) -> None:
    """Each is a message of its topic's type: others read it with that type's definition."""
    ((topic, payload),) = list(ros.encoder(name)(SAMPLES[name], prefix))
    assert topic == name
    message = STORE.deserialize_cdr(payload, TOPICS[topic].type)
    if hasattr(message, "header"):
        assert message.header.frame_id == ("map" if name == "usbl" else f"{prefix}{name}_link")
    decoder = ros.decoder(topic)
    assert decoder is not None
    sample, expected = decoder(payload), SAMPLES[name]
    if isinstance(expected, FlagSample):
        assert sample is expected.on
    elif isinstance(expected, ImuSample):
        assert sample.orientation == pytest.approx(expected.orientation)
        assert sample[2:] == expected[2:]
    else:
        assert sample == expected
