"""ROS 2 messages as rmw_zenoh transports them: payloads, type hashes, keys and attachments.

This is the one place where our frames (world NED, body FRD) are converted to and from those of ROS (world ENU, body
FLU, REP 103): encoders take ours and send theirs; decoders return ours, or None for a malformed payload. Covariances
are diagonals; 0 means "unknown", as in ROS, and -1 that something is not measured.
"""

from collections.abc import Callable, Iterable, Sequence
from functools import lru_cache, partial
from importlib import import_module
from math import isfinite, sqrt
from struct import Struct, pack
from typing import Any, NamedTuple

from hil.common.vectors import Quaternion, Vector3
from hil.ros import dialect
from hil.ros.cdr import HEADER, Layout, MalformedError, Reader, Writer, check_header, diagonal, tolerant
from hil.ros.topics import TOPICS, first_of
from sim.sensors.kinds import SENSORS
from sim.sensors.samples import ImuSample, OdometrySample, PressureSample

Status = tuple[str, int, str, dict[str, str]]  # name, level (0 ok, 1 warning, 2 error, 3 stale), message, values

_NS_PER_S = 1_000_000_000
_HALF_SQRT = sqrt(0.5)
NO_DATA = -1.0  # first element of a covariance if the measurement is missing, as in sensor_msgs/Imu

_TWIST = Struct("<4s6d")
_IMU = Layout("i I string 4d 72s 3d 72s 3d 72s")
_ODOMETRY = Layout("i I string string 7d 288s 6d 288s")
_PRESSURE = Layout("i I string 2d")
RANGE, RANGE_HUMBLE = Layout("i I string B 5f"), Layout("i I string B 4f")
_TRANSFORMS = Layout("I i I string string 7d")  # a message with one transform
_UNKNOWN = (0.0, 0.0, 0.0, 0.0, 0.0)
_ATTACHMENT = Struct("<qqB16s")


class Attachment(NamedTuple):
    """Attachment of rmw_zenoh to a message: sequence number, send time (wall, ns), `gid` of the publisher.

    `master` identifies the process that commands through several publishers; elsewhere it is the gid.
    """

    sequence: int
    time_ns: int
    gid: bytes
    master: bytes


def swap_world(vector: Sequence[float]) -> Vector3:
    """Convert NED to ENU, or ENU to NED; like the other two swaps it is its own inverse."""
    x, y, z = vector
    return y, x, -z


def swap_body(vector: Sequence[float]) -> Vector3:
    """Convert FRD to FLU, or FLU to FRD, for velocities, angular velocities and accelerations."""
    x, y, z = vector
    return x, -y, -z


def swap_attitude(quaternion: Sequence[float]) -> Quaternion:
    """Return the attitude (w, x, y, z) of FLU in ENU from that of FRD in NED, or the other way round.

    This is the product of three quaternions: a half turn of the world about its north-east diagonal, the attitude, and
    a half turn of the body about its x axis.
    """
    w, x, y, z = quaternion
    return _HALF_SQRT * (w + z), _HALF_SQRT * (x + y), _HALF_SQRT * (x - y), _HALF_SQRT * (w - z)


def encode_twist(linear: Sequence[float], angular: Sequence[float]) -> bytes:
    """Encode geometry_msgs/Twist of body velocities: `linear` m/s and `angular` rad/s along FRD."""
    return _TWIST.pack(HEADER, *swap_body(linear), *swap_body(angular))


@tolerant
def decode_twist(data: bytes) -> tuple[Vector3, Vector3]:
    """Return linear (m/s) and angular (rad/s) velocity along FRD; values that are not finite count as malformed."""
    check_header(data)
    _, x, y, z, p, q, r = _TWIST.unpack_from(data)
    if not isfinite(abs(x) + abs(y) + abs(z) + abs(p) + abs(q) + abs(r)):
        raise MalformedError("not a velocity")
    return (x, -y, -z), (p, -q, -r)


def encode_imu(sample: ImuSample, frame: str = "imu_link", variances: Sequence[float] = (0.0, 0.0, 0.0, 0.0)) -> bytes:
    """Encode sensor_msgs/Imu. `variances`: roll and pitch, yaw rad², turn rate (rad/s)², acceleration (m/s²)²."""
    # In frequent messages the swaps are inlined: with cold caches each call costs a microsecond.
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
    """Return the sample in NED and FRD, without covariances."""
    time_ns, (x, y, z, w, _, p, q, r, _, ax, ay, az, _) = unpack_stamped(_IMU, data)
    return ImuSample(time_ns, swap_attitude((w, x, y, z)), swap_body((p, q, r)), swap_body((ax, ay, az)))


def encode_pressure(sample: PressureSample, frame: str = "pressure_link", variance: float = 0.0) -> bytes:
    """Encode sensor_msgs/FluidPressure: absolute pressure. `variance` in Pa²."""
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
    """Encode nav_msgs/Odometry: pose in the world `frame`, velocities along the body `child`.

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
    """Return the sample in NED and FRD, without covariances."""
    time_ns, (east, north, up, x, y, z, w, _, *nu, _) = unpack_stamped(_ODOMETRY, data)
    return OdometrySample(
        time_ns, swap_world((east, north, up)), swap_attitude((w, x, y, z)), swap_body(nu[:3]) + swap_body(nu[3:])
    )


def encode_transform(sample: OdometrySample, frame: str = "odom", child: str = "base_link") -> bytes:
    """Encode tf2_msgs/TFMessage with one transform: the pose of `child` in `frame`, from the sample."""
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
    """Return a sensor_msgs/Range; for Humble without its last value, the variance."""
    data = pack_stamped(RANGE, time_ns, names, *values)
    return data[:-4] if dialect.is_humble() else data


def unpack_stamped(layout: Layout, data: bytes) -> tuple[int, tuple[Any, ...]]:
    """Return the stamp (ns) and the values after the frame names."""
    values = layout.unpack(data)
    return values[1] * _NS_PER_S + values[2], values[3 + 2 * layout.strings :]


def encode_int64_array(values: Sequence[int]) -> bytes:
    """Encode std_msgs/Int64MultiArray without dimensions."""
    padding = "4x" if values else ""
    return pack(f"<4s3I{padding}{len(values)}q", HEADER, 0, 0, len(values), *values)  # no dimensions, no offset


@tolerant
def decode_int64_array(data: bytes) -> tuple[int, ...]:
    """Return the values; dimensions are ignored."""
    return array_values(data, "q")


def array_values(data: bytes, kind: str) -> tuple[Any, ...]:
    """Return the values of a std_msgs multi-array, whose elements have the `struct` type `kind`.

    Raises MalformedError if the message is shorter than it announces.
    """
    reader = Reader(data)
    for _ in range(reader.count()):  # dimensions
        reader.string()
        reader.numbers("I", 2)
    reader.numbers("I")  # the offset
    return reader.numbers(kind, reader.count())


def encode_diagnostics(time_ns: int, statuses: Sequence[Status], hardware_id: str = "") -> bytes:
    """Encode diagnostic_msgs/DiagnosticArray."""
    seconds, ns = divmod(time_ns, _NS_PER_S)
    writer = Writer()
    writer.numbers("i", seconds)
    writer.numbers("I", ns)
    writer.string("")
    writer.numbers("I", len(statuses))
    for name, level, message, values in statuses:
        writer.numbers("B", level)
        for text in (name, message, hardware_id):
            writer.string(text)
        writer.numbers("I", len(values))
        for pair in values.items():
            for text in pair:
                writer.string(text)
    return bytes(writer.data)


@tolerant
def decode_diagnostics(data: bytes) -> list[Status]:
    """Return the statuses; stamp and hardware id are ignored."""
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


@lru_cache(256)
def dds_name(type_name: str) -> str:
    """Return the name of a type in keys: sensor_msgs::msg::dds_::Imu_."""
    package, kind, name = type_name.split("/")
    return f"{package}::{kind}::dds_::{name}_"


def pack_attachment(sequence: int, time_ns: int, gid: bytes) -> bytes:
    """Return the 33 bytes of an attachment; `sequence` from 1, `time_ns` by the wall clock, `gid` 16 bytes.

    A master appends its id, 16 bytes, which readers of rmw_zenoh leave unread.
    """
    return _ATTACHMENT.pack(sequence, time_ns, 16, gid)


def unpack_attachment(data: bytes) -> Attachment | None:
    """Return the values that `pack_attachment` packed, and the master; None for other bytes."""
    if len(data) not in (_ATTACHMENT.size, _ATTACHMENT.size + 16):
        return None
    sequence, time_ns, length, gid = _ATTACHMENT.unpack_from(data)
    return Attachment(sequence, time_ns, gid, data[_ATTACHMENT.size :] or gid) if length == 16 else None


Encoded = Iterable[tuple[str, bytes]]
Encoder = Callable[..., Encoded]  # takes a sample, a prefix of frame names, and perhaps variances
Decoder = Callable[[bytes], Any]


def encoder(topic: str) -> Encoder:
    """Return the function that encodes the simulator's samples called `topic` as messages, each with its ROS topic.

    Its second argument is the prefix of the vehicle's frame names ("uuv1/" gives "uuv1/imu_link"), or "". Further ones
    are variances, if `sim.sensors.variances` has them, and the sensor's `name`.
    """
    known = _ENCODERS.get(topic)
    if known is None:
        first = first_of(topic)
        if first != topic:  # another sensor of the same kind uses its own name in topics and frames
            known = partial(encoder(first), name=topic)
        else:
            encoders = _later(topic).ENCODERS
            known = encoders.get(topic) or partial(encoders[TOPICS[topic].type], name=topic)
        _ENCODERS[topic] = known
    return known


def decoder(topic: str) -> Decoder | None:
    """Return the function that decodes messages of a topic in `hil.ros.topics`; None for an unknown topic."""
    first = first_of(topic)
    if known := _DECODERS.get(topic) or _DECODERS.get(first):
        return known
    decoders: dict[str, Decoder] = _later(first).DECODERS
    return decoders.get(first) or (decoders.get(TOPICS[first].type) if first in TOPICS else None)


def introduce(topic: str, encode: Encoder, decode: Decoder) -> None:
    """Register the encoder and decoder of a user's own sensor (hil.ros.own)."""
    _ENCODERS[topic] = encode
    _DECODERS[topic] = decode


def _later(topic: str) -> Any:
    """Return the module with the codecs of a topic, or of its type; loaded after the vehicle is ready, if at all."""
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
    **{name: kind.codec for name, kind in SENSORS.items()},
    **{each.topic: kind.codec for kind in SENSORS.values() for each in kind.streams},
    "scanning_sonar/image": "images",
    **dict.fromkeys(("/tf", "/tf_static", "/clock", "thruster_wrench"), "frames"),
    **dict.fromkeys(("robot_description", "map", "obstacles", "/parameter_events", "/rosout"), "world"),
    **dict.fromkeys(("joint_states", "motors", "accessories", "cmd_accessories"), "joints"),
    **dict.fromkeys(("formation", "modem_tx", "modem_rx", "modem_range", "modem_position"), "fleet"),
    **dict.fromkeys(("plan", "tether"), "plan"),
}
