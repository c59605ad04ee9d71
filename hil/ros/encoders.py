"""ROS 2 messages as rmw_zenoh carries them: payloads, type hashes, keys and attachments.

This is the one place where our frames (world NED, body FRD) and those of ROS (world ENU, body FLU, REP 103)
meet: every encoder takes ours and sends theirs, every decoder gives ours back, or None for a malformed
payload. Covariances are diagonals; 0 means "unknown", as in ROS, and -1 that something is not measured.
"""

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from importlib import import_module
from math import isfinite, sqrt
from struct import Struct, pack
from typing import Any, NamedTuple

from hil.common.vectors import Quaternion, Vector3
from hil.ros import dialect
from hil.ros.cdr import HEADER, Layout, MalformedError, Reader, Writer, check_header, diagonal, tolerant
from hil.ros.topics import first_of
from sim.sensors.samples import ImuSample, OdometrySample, PressureSample

Status = tuple[str, int, str, dict[str, str]]  # name, level (0 ok, 1 warning, 2 error, 3 stale), message, values

_NS_PER_S = 1_000_000_000
_HALF_SQRT = sqrt(0.5)
NO_DATA = -1.0  # first element of a covariance whose measurement is missing, as sensor_msgs/Imu has it

_TWIST = Struct("<4s6d")
_IMU = Layout("i I string 4d 72s 3d 72s 3d 72s")
_ODOMETRY = Layout("i I string string 7d 288s 6d 288s")
_PRESSURE = Layout("i I string 2d")
RANGE, RANGE_HUMBLE = Layout("i I string B 5f"), Layout("i I string B 4f")
_TRANSFORMS = Layout("I i I string string 7d")  # of one
_UNKNOWN = (0.0, 0.0, 0.0, 0.0, 0.0)
_ATTACHMENT = Struct("<qqB16s")


class Attachment(NamedTuple):
    """Attachment of rmw_zenoh to a message: sequence number, time of sending (ns, wall), publisher `gid`."""

    sequence: int
    time_ns: int
    gid: bytes


def swap_world(vector: Sequence[float]) -> Vector3:
    """NED to ENU, or ENU to NED: like the other two swaps its own inverse."""
    x, y, z = vector
    return y, x, -z


def swap_body(vector: Sequence[float]) -> Vector3:
    """FRD to FLU, or FLU to FRD; for velocities, angular velocities and accelerations alike."""
    x, y, z = vector
    return x, -y, -z


def swap_attitude(quaternion: Sequence[float]) -> Quaternion:
    """Return the attitude (w, x, y, z) of FRD in NED to that of FLU in ENU, or back.

    The half turn of the world about its north-east diagonal, the attitude, the half turn of the body about
    its x axis: three quaternions multiplied out.
    """
    w, x, y, z = quaternion
    return _HALF_SQRT * (w + z), _HALF_SQRT * (x + y), _HALF_SQRT * (x - y), _HALF_SQRT * (w - z)


def encode_twist(linear: Sequence[float], angular: Sequence[float]) -> bytes:
    """geometry_msgs/Twist of body velocities: `linear` m/s and `angular` rad/s along FRD."""
    return _TWIST.pack(HEADER, *swap_body(linear), *swap_body(angular))


@tolerant
def decode_twist(data: bytes) -> tuple[Vector3, Vector3]:
    """Linear (m/s) and angular (rad/s) velocity along FRD. What is not finite counts as malformed."""
    check_header(data)
    _, x, y, z, p, q, r = _TWIST.unpack(data)  # of exactly this size: a TwistStamped would be other numbers
    if not isfinite(abs(x) + abs(y) + abs(z) + abs(p) + abs(q) + abs(r)):
        raise MalformedError("not a velocity")
    return (x, -y, -z), (p, -q, -r)


def encode_imu(sample: ImuSample, frame: str = "imu_link", variances: Sequence[float] = (0.0, 0.0, 0.0, 0.0)) -> bytes:
    """sensor_msgs/Imu. `variances`: of roll and pitch, yaw rad², angular velocity (rad/s)², acceleration (m/s²)²."""
    # Of the frequent messages the swaps are written out here: a call less is a microsecond less where caches are cold.
    struct, (size, name) = _IMU.named((frame,))
    level, heading, turning, pushing = variances
    attitude, rate, force = diagonal(3, level, level, heading), diagonal(3, turning, 0.0), diagonal(3, pushing, 0.0)
    time_ns, (w, x, y, z), (p, q, r), (ax, ay, az) = sample
    return struct.pack(
        HEADER, time_ns // _NS_PER_S, time_ns % _NS_PER_S, size, name,
        _HALF_SQRT * (x + y), _HALF_SQRT * (x - y), _HALF_SQRT * (w - z), _HALF_SQRT * (w + z), attitude,
        p, -q, -r, rate,
        ax, -ay, -az, force,
    )  # fmt: skip


@tolerant
def decode_imu(data: bytes) -> ImuSample:
    """Return the sample in NED and FRD; covariances are left."""
    time_ns, (x, y, z, w, _, p, q, r, _, ax, ay, az, _) = unpack_stamped(_IMU, data)
    return ImuSample(time_ns, swap_attitude((w, x, y, z)), swap_body((p, q, r)), swap_body((ax, ay, az)))


def encode_pressure(sample: PressureSample, frame: str = "pressure_link", variance: float = 0.0) -> bytes:
    """sensor_msgs/FluidPressure: absolute pressure. `variance` in Pa²."""
    return pack_stamped(_PRESSURE, sample.time_ns, (frame,), sample.pascal, variance)


@tolerant
def decode_pressure(data: bytes) -> PressureSample:
    """Return the absolute pressure in Pa."""
    time_ns, (pascal, _) = unpack_stamped(_PRESSURE, data)
    return PressureSample(time_ns, pascal)


def encode_odometry(
    sample: OdometrySample,
    frame: str = "odom",
    child: str = "base_link",
    variances: Sequence[float] = (0.0, 0.0, 0.0, 0.0, 0.0),
) -> bytes:
    """nav_msgs/Odometry: pose in the world `frame`, velocities along the body `child`.

    `variances`: of horizontal position and depth m², attitude rad², velocity (m/s)², angular velocity (rad/s)².
    """
    struct, (size, name, child_size, child_name) = _ODOMETRY.named((frame, child))
    horizontal, depth, attitude, velocity, rate = variances
    time_ns, (north, east, down), (w, x, y, z), (u, v, sink, p, q, r) = sample
    return struct.pack(
        HEADER, time_ns // _NS_PER_S, time_ns % _NS_PER_S, size, name, child_size, child_name,
        east, north, -down,
        _HALF_SQRT * (x + y), _HALF_SQRT * (x - y), _HALF_SQRT * (w - z), _HALF_SQRT * (w + z),
        diagonal(6, horizontal, attitude, depth), u, -v, -sink, p, -q, -r, diagonal(6, velocity, rate),
    )  # fmt: skip


@tolerant
def decode_odometry(data: bytes) -> OdometrySample:
    """Return the sample in NED and FRD; covariances are left."""
    time_ns, (east, north, up, x, y, z, w, _, *nu, _) = unpack_stamped(_ODOMETRY, data)
    return OdometrySample(
        time_ns, swap_world((east, north, up)), swap_attitude((w, x, y, z)), swap_body(nu[:3]) + swap_body(nu[3:])
    )


def encode_transform(sample: OdometrySample, frame: str = "odom", child: str = "base_link") -> bytes:
    """tf2_msgs/TFMessage of one transform: where `child` is in `frame`, by the sample."""
    struct, (size, name, child_size, child_name) = _TRANSFORMS.named((frame, child))
    time_ns, (north, east, down), (w, x, y, z), _ = sample
    return struct.pack(
        HEADER, 1, time_ns // _NS_PER_S, time_ns % _NS_PER_S, size, name, child_size, child_name,
        east, north, -down,
        _HALF_SQRT * (x + y), _HALF_SQRT * (x - y), _HALF_SQRT * (w - z), _HALF_SQRT * (w + z),
    )  # fmt: skip


def pack_stamped(layout: Layout, time_ns: int, names: tuple[str, ...], *values: Any) -> bytes:
    """Return a message that begins with a std_msgs/Header: the stamp, then frame names, then `values`."""
    struct, strings = layout.named(names)
    return struct.pack(HEADER, time_ns // _NS_PER_S, time_ns % _NS_PER_S, *strings, *values)


def pack_range(time_ns: int, names: tuple[str], *values: Any) -> bytes:
    """Return a sensor_msgs/Range, whose last value, the variance, Humble does not have."""
    data = pack_stamped(RANGE, time_ns, names, *values)
    return data[:-4] if dialect.is_humble() else data


def unpack_stamped(layout: Layout, data: bytes) -> tuple[int, tuple[Any, ...]]:
    """Return time in ns and the values behind the frame names."""
    values = layout.unpack(data)
    return values[1] * _NS_PER_S + values[2], values[3 + 2 * layout.strings :]


def encode_int64_array(values: Sequence[int]) -> bytes:
    """std_msgs/Int64MultiArray of one plain row."""
    padding = "4x" if values else ""
    return pack(f"<4s3I{padding}{len(values)}q", HEADER, 0, 0, len(values), *values)  # no dimensions named, no offset


@tolerant
def decode_int64_array(data: bytes) -> tuple[int, ...]:
    """Return the values; the names of dimensions are left."""
    return array_values(data, "q")


def array_values(data: bytes, kind: str) -> tuple[Any, ...]:
    """Return the values of a std_msgs multi-array, whose elements are of this `kind` of struct.

    Raises MalformedError if the message does not hold what it announces.
    """
    reader = Reader(data)
    for _ in range(reader.count()):  # dimensions
        reader.string()
        reader.numbers("I", 2)
    reader.numbers("I")  # the offset
    return reader.numbers(kind, reader.count())


def encode_diagnostics(time_ns: int, statuses: Sequence[Status], hardware_id: str = "") -> bytes:
    """diagnostic_msgs/DiagnosticArray."""
    seconds, ns = divmod(time_ns, _NS_PER_S)
    writer = Writer()
    writer.numbers("i", seconds)
    writer.numbers("I", ns)
    writer.string("")
    writer.numbers("I", len(statuses))
    for name, level, message, values in statuses:
        writer.numbers("B", level)
        for words in (name, message, hardware_id):
            writer.string(words)
        writer.numbers("I", len(values))
        for pair in values.items():
            for words in pair:
                writer.string(words)
    return bytes(writer.data)


@tolerant
def decode_diagnostics(data: bytes) -> list[Status]:
    """Return the statuses; stamp and hardware are left."""
    reader = Reader(data)
    reader.numbers("I", 2)
    reader.string()
    return [_status(reader) for _ in range(reader.count())]


def _status(reader: Reader) -> Status:
    (level,) = reader.numbers("B")
    name, message, _ = reader.string(), reader.string(), reader.string()
    return name, level, message, {reader.string(): reader.string() for _ in range(reader.count())}


def data_key(domain: int, topic: str, type_name: str, type_hash: str) -> str:
    """Return the zenoh key of a topic: data_key(0, "/imu", "sensor_msgs/msg/Imu", "RIHS01_…")."""
    return f"{domain}/{topic.strip('/')}/{dds_name(type_name)}/{type_hash}"


def dds_name(type_name: str) -> str:
    """Return how a type is called in keys: sensor_msgs::msg::dds_::Imu_."""
    package, kind, name = type_name.split("/")
    return f"{package}::{kind}::dds_::{name}_"


def pack_attachment(sequence: int, time_ns: int, gid: bytes) -> bytes:
    """Return the 33 bytes beside a message; `sequence` from 1, `time_ns` of the wall clock, `gid` 16 bytes."""
    return _ATTACHMENT.pack(sequence, time_ns, 16, gid)


def unpack_attachment(data: bytes) -> Attachment | None:
    """Return what `pack_attachment` packed, or None if that is not it."""
    if len(data) != _ATTACHMENT.size:
        return None
    sequence, time_ns, length, gid = _ATTACHMENT.unpack(data)
    return Attachment(sequence, time_ns, gid) if length == 16 else None


Encoded = Iterable[tuple[str, bytes]]
Encoder = Callable[..., Encoded]  # of a sample, a prefix, and perhaps variances
Decoder = Callable[[bytes], Any]


def encoder(topic: str) -> Encoder:
    """Return what turns the simulator's samples called `topic` into messages, each with the topic it goes out on.

    Its second argument is set before the names of the vehicle's frames ("uuv1/imu_link"), empty for none. Others are
    the variances of what is measured, where `sim.sensors.spread` has them, and `name` is the sensor's own.
    """
    known = _ENCODERS.get(topic)
    if known is None:
        first = first_of(topic)
        # The topics and frames of one more of a kind have its name instead.
        known = _later(topic).ENCODERS[topic] if first == topic else partial(encoder(first), name=topic)
        _ENCODERS[topic] = known
    return known


def decoder(topic: str) -> Decoder | None:
    """Return what turns a message on one of the topics of `hil.ros.topics` into our records; None for another topic."""
    first = first_of(topic)
    return _DECODERS.get(topic) or _DECODERS.get(first) or _later(first).DECODERS.get(first)


def introduce(topic: str, encode: Encoder, decode: Decoder) -> None:
    """Let the samples of a sensor of a user's own go out and come in by its class (hil.ros.own)."""
    _ENCODERS[topic] = encode
    _DECODERS[topic] = decode


def _later(topic: str) -> Any:
    """Return the module of the topic: loaded when the vehicle is ready, or never."""
    return import_module(f"hil.ros.{_ELSEWHERE.get(topic, 'sensors')}")


def _encode_imu(sample: ImuSample, prefix: str, *variances: float, name: str = "imu") -> Encoded:
    return [(name, encode_imu(sample, f"{prefix}{name}_link", variances or _UNKNOWN[:4]))]


def _encode_pressure(sample: PressureSample, prefix: str, variance: float = 0.0, name: str = "pressure") -> Encoded:
    return [(name, encode_pressure(sample, f"{prefix}{name}_link", variance))]


def _encode_odom(sample: OdometrySample, prefix: str, *variances: float) -> Encoded:
    frames = f"{prefix}odom", f"{prefix}base_link"
    return [
        ("odom", encode_odometry(sample, *frames, variances or _UNKNOWN)),
        ("/tf", encode_transform(sample, *frames)),
    ]


_ENCODERS: dict[str, Encoder] = {
    "imu": _encode_imu,
    "pressure": _encode_pressure,
    "odom": _encode_odom,
    "ground_truth": lambda sample, prefix: [("ground_truth", encode_odometry(sample, "map", f"{prefix}base_link"))],
}
_DECODERS: dict[str, Decoder] = {
    "cmd_vel": decode_twist,
    "trace": decode_int64_array,
    "imu": decode_imu,
    "pressure": decode_pressure,
    "odom": decode_odometry,
    "ground_truth": decode_odometry,
    "diagnostics": decode_diagnostics,
    "/diagnostics": decode_diagnostics,
}
_ELSEWHERE = {
    **dict.fromkeys(("cmd_depth", "cmd_heading", "cmd_pose", "cmd_wrench"), "commands"),
    **dict.fromkeys(("cmd_thrusters", "cmd_vel_stamped"), "commands"),
    **dict.fromkeys(("dvl", "dvl_twist", "altitude", "dvl_water"), "dvl"),
    **dict.fromkeys(("laser", "profiler", "profiler/points", "scanning_sonar", "echosounder"), "scans"),
    **dict.fromkeys(("camera", "forward_sonar", "side_scan"), "images"),  # the sensors, and then their topics
    **dict.fromkeys(("camera/image_raw", "camera/image_raw/compressed", "camera/camera_info"), "images"),
    **dict.fromkeys(("camera/depth/image_raw", "camera/depth/camera_info", "camera/depth/points"), "images"),
    "camera/labels": "images",
    **dict.fromkeys(
        ("forward_sonar/image", "forward_sonar/fan/image_raw", "scanning_sonar/image", "side_scan/image"), "images"
    ),
    **dict.fromkeys(("/tf", "/tf_static", "/clock", "thruster_wrench"), "frames"),
    **dict.fromkeys(("robot_description", "map", "obstacles", "/parameter_events"), "world"),
    **dict.fromkeys(("joint_states", "motors"), "joints"),
    "formation": "formation",
    **dict.fromkeys(("plan", "tether"), "plan"),
    **dict.fromkeys(("modem_tx", "modem_rx", "modem_range"), "modem"),
}
