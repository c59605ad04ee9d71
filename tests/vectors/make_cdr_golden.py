"""Writes cdr_golden.json: ROS 2 messages as another implementation serialises them, and its type hashes.

Run by hand when a message is added. Its peer is rosbags (Ternaris); the tests read the file and make it again.
"""

import importlib
import json
import math
import os
from typing import Any

STAMP = {"sec": 1_700_000_000, "nanosec": 123_456_789}
HALF = 0.5**0.5
PLAIN: dict[str, Any] = {"dim": [], "data_offset": 0}
DIAGONAL_3 = [[float(v) if i == j else 0.0 for j in range(3) for i in range(3)] for v in (1, 2, 3)]


def diagonal_6(first: float, last: float) -> list[float]:
    return [(first if i < 3 else last) if i == j else 0.0 for i in range(6) for j in range(6)]


def header(frame: str) -> dict[str, Any]:
    return {"stamp": STAMP, "frame_id": frame}


def xyz(x: float, y: float, z: float) -> dict[str, float]:
    return {"x": x, "y": y, "z": z}


def imu(frame: str, attitude: tuple[float, float, float, float]) -> dict[str, Any]:
    w, x, y, z = attitude
    return {
        "header": header(frame),
        "orientation": {"x": x, "y": y, "z": z, "w": w},
        "orientation_covariance": DIAGONAL_3[0],
        "angular_velocity": xyz(0.1, -0.2, 0.3),
        "angular_velocity_covariance": DIAGONAL_3[1],
        "linear_acceleration": xyz(-0.4, 0.5, 9.75),
        "linear_acceleration_covariance": DIAGONAL_3[2],
    }


def odometry(frame: str, child: str) -> dict[str, Any]:
    return {
        "header": header(frame),
        "child_frame_id": child,
        "pose": {
            "pose": {"position": xyz(10.5, -20.25, -3.125), "orientation": {"x": 0.0, "y": 0.0, "z": HALF, "w": HALF}},
            "covariance": diagonal_6(0.25, 0.5),
        },
        "twist": {
            "twist": {"linear": xyz(1.5, -0.25, 0.125), "angular": xyz(0.01, -0.02, 0.03)},
            "covariance": diagonal_6(0.75, 1.25),
        },
    }


def statuses() -> list[dict[str, Any]]:
    return [
        {
            "level": 1,
            "name": "slave",
            "message": "CPU über 80 %",
            "hardware_id": "pi4b",
            "values": [
                {"key": "cpu", "value": "81"},
                {"key": "", "value": ""},
                {"key": "temperature", "value": "66.5"},
            ],
        },
        {"level": 0, "name": "", "message": "", "hardware_id": "pi4b", "values": []},
    ]


def ranges() -> dict[str, Any]:
    return {"header": header("dvl_link"), "radiation_type": 0, "field_of_view": 0.0, "min_range": 0.5,
            "max_range": 75.0, "range": 12.375, "variance": 0.0625}  # fmt: skip


def battery() -> dict[str, Any]:
    return {"header": header("battery_link"), "voltage": 15.5, "temperature": None, "current": -12.25, "charge": 4.5,
            "capacity": 18.0, "design_capacity": 18.0, "percentage": 0.25, "power_supply_status": 2,
            "power_supply_health": 1, "power_supply_technology": 2, "present": True, "cell_voltage": [],
            "cell_temperature": [], "location": "", "serial_number": ""}  # fmt: skip


def fix(status: int, place: tuple[float | None, float | None, float | None], variances: list[float]) -> dict[str, Any]:
    covariance = [variances[i] if i == j else 0.0 for i in range(3) for j in range(3)]
    return {"header": header("gps_link"), "status": {"status": status, "service": 1}, "latitude": place[0],
            "longitude": place[1], "altitude": place[2], "position_covariance": covariance,
            "position_covariance_type": 2 if status >= 0 else 0}  # fmt: skip


def position() -> dict[str, Any]:
    rows = [[4.0, 0.5, -0.25], [0.5, 2.0, 0.125], [-0.25, 0.125, 1.0]]
    covariance = [rows[i][j] if max(i, j) < 3 else -1.0 if i == j else 0.0 for i in range(6) for j in range(6)]
    pose = {"position": xyz(120.5, -30.25, -8.0), "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}}
    return {"header": header("map"), "pose": {"pose": pose, "covariance": covariance}}


def field() -> dict[str, Any]:
    return {"header": header("magnetometer_link"), "magnetic_field": xyz(2.0e-5, -1.5e-6, -4.5e-5),
            "magnetic_field_covariance": [1e-12 if i == j else 0.0 for i in range(3) for j in range(3)]}  # fmt: skip


def dvl() -> dict[str, Any]:
    beams = {"beam_unit_vec": [xyz(0.0, 0.0, 0.0)] * 4, "range": [0.0] * 4, "range_covar": [0.0] * 4,
             "beam_quality": [0.0] * 4, "beam_velocity": [0.0] * 4, "beam_velocity_covar": [0.0] * 4}  # fmt: skip
    return {"header": header("dvl_transducer_link"), "velocity_mode": 1, "dvl_type": 0,
            "velocity": xyz(0.5, 0.25, -0.125), "velocity_covar": [0.0625 * (i % 4 == 0) for i in range(9)],
            "altitude": 12.375, "course_gnd": math.atan2(0.25, 0.5), "speed_gnd": math.hypot(0.5, 0.25),
            "num_good_beams": 4, "sound_speed": 0.0, "beam_ranges_valid": False, "beam_velocities_valid": False,
            **beams}  # fmt: skip


def transform(frame: str, child: str) -> dict[str, Any]:
    return {"header": header(frame), "child_frame_id": child,
            "transform": {"translation": xyz(10.5, -20.25, -3.125),
                          "rotation": {"x": 0.0, "y": 0.0, "z": HALF, "w": HALF}}}  # fmt: skip


CASES: list[tuple[str, dict[str, Any]]] = [
    ("geometry_msgs/msg/Twist", {"linear": xyz(1.5, -0.5, 0.25), "angular": xyz(0.125, -0.25, 0.75)}),
    ("sensor_msgs/msg/Imu", imu("imu_link", (HALF, 0.0, 0.0, HALF))),
    ("sensor_msgs/msg/Imu", imu("vehicle_1/imu", (0.1, -0.5, 0.7, 0.5))),
    ("nav_msgs/msg/Odometry", odometry("odom", "base_link")),
    ("nav_msgs/msg/Odometry", odometry("map", "a")),
    ("sensor_msgs/msg/FluidPressure", {"header": header("p"), "fluid_pressure": 201_325.5, "variance": 4.0}),
    ("geometry_msgs/msg/TwistWithCovarianceStamped", {
        "header": header("dvl_link"),
        "twist": {"twist": {"linear": xyz(0.5, -0.25, 0.125), "angular": xyz(0.0, 0.0, 0.0)},
                  "covariance": diagonal_6(0.0625, 0.0)}}),
    ("sensor_msgs/msg/Range", ranges()),
    ("std_msgs/msg/Int64MultiArray", {"layout": PLAIN, "data": [1, -2, 1_700_000_000_123_456_789]}),
    ("std_msgs/msg/Int64MultiArray", {"layout": PLAIN, "data": []}),
    ("std_msgs/msg/Int64MultiArray", {
        "layout": {"dim": [{"label": "rows", "size": 1, "stride": 2}, {"label": "c", "size": 2, "stride": 2}],
                   "data_offset": 0},
        "data": [7, 8]}),
    ("diagnostic_msgs/msg/DiagnosticArray", {"header": header(""), "status": statuses()}),
    ("diagnostic_msgs/msg/DiagnosticArray", {"header": header(""), "status": []}),
    ("std_msgs/msg/Bool", {"data": True}),
    ("std_msgs/msg/Bool", {"data": False}),
    ("sensor_msgs/msg/NavSatFix", fix(0, (57.70889, 11.97456, 36.25), [4.5, 4.5, 10.25])),
    ("sensor_msgs/msg/NavSatFix", fix(-1, (None, None, None), [0.0, 0.0, 0.0])),
    ("sensor_msgs/msg/MagneticField", field()),
    ("geometry_msgs/msg/PoseWithCovarianceStamped", position()),
    ("geometry_msgs/msg/TwistStamped", {
        "header": header("current_meter_link"),
        "twist": {"linear": xyz(-0.5, 0.25, 0.125), "angular": xyz(0.0, 0.0, 0.0)}}),
    ("sensor_msgs/msg/BatteryState", battery()),
    ("marine_acoustic_msgs/msg/Dvl", dvl()),
    ("tf2_msgs/msg/TFMessage", {"transforms": [transform("odom", "base_link")]}),
    ("tf2_msgs/msg/TFMessage", {"transforms": [transform("map", "a"), transform("uuv1/base_link", "uuv1/b")]}),
    ("tf2_msgs/msg/TFMessage", {"transforms": []}),
    ("rosgraph_msgs/msg/Clock", {"clock": STAMP}),
    ("sensor_msgs/msg/LaserScan", {
        "header": header("laser_link"), "angle_min": -0.5, "angle_max": 0.5, "angle_increment": 0.25,
        "time_increment": 0.0, "scan_time": 0.0, "range_min": 0.5, "range_max": 20.0,
        "ranges": [5.0, 4.0, 3.0, 2.0, 1.0], "intensities": []}),
    ("geometry_msgs/msg/WrenchStamped", {
        "header": header("base_link"),
        "wrench": {"force": xyz(12.5, -3.25, 40.5), "torque": xyz(0.5, -1.25, 2.75)}}),
]  # fmt: skip


def build(store: Any, typename: str, fields: dict[str, Any]) -> Any:
    """Return the message object of `typename` from nested dicts, as the definition of the type says."""
    values = {name: convert(store, kind, fields[name]) for name, kind in store.fielddefs[typename][1]}
    return store.types[typename](**values)


def convert(store: Any, kind: Any, value: Any) -> Any:
    node, detail = kind
    if node.name == "NAME":
        return build(store, detail, value)
    if node.name == "BASE":
        return float("nan") if value is None else value  # what JSON cannot say
    (inner, of), _ = detail
    if inner.name == "NAME":
        return [build(store, of, item) for item in value]
    return importlib.import_module("numpy").array(value, dtype=of[0])


def marine_types(read: Any) -> dict[str, Any]:
    """Return the messages of marine_acoustic_msgs, which rosbags has not, from our definitions of them."""
    path = os.path.join(os.path.dirname(__file__), "..", "..", "hil", "ros", "types", "marine_acoustic_msgs.msg")
    found: dict[str, Any] = {}
    with open(path) as file:
        for block in file.read().split("=== ")[1:]:
            head, _, text = block.partition("\n")
            found |= read(text, head.split()[0])
    return found


def golden() -> dict[str, Any]:
    typesys = importlib.import_module("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
    store.register(marine_types(typesys.get_types_from_msg))
    return {
        "source": "rosbags 0.11.9, typestore ROS2_JAZZY",
        "hashes": {name: store.hash_rihs01(name) for name in sorted({name for name, _ in CASES})},
        "messages": [
            {"type": name, "fields": fields, "hex": bytes(store.serialize_cdr(build(store, name, fields), name)).hex()}
            for name, fields in CASES
        ],
    }


def write(path: str) -> None:
    """Write one message a line, so that a difference shows which changed."""
    found = golden()
    lines = ",\n".join(json.dumps(message, ensure_ascii=False) for message in found.pop("messages"))
    head = json.dumps(found, indent=1)[:-2]
    with open(path, "w", encoding="utf-8") as file:
        file.write(f'{head},\n "messages": [\n{lines}\n ]\n}}\n')


if __name__ == "__main__":
    write(os.path.join(os.path.dirname(__file__), "cdr_golden.json"))
