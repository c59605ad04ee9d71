"""ROS 2 messages as rmw_zenoh carries them: payloads, type hashes, keys and attachments.

This is the one place where our frames (world NED, body FRD) and those of ROS (world ENU, body FLU, REP 103)
meet: every encoder takes ours and sends theirs, every decoder gives ours back, or None for a malformed
payload. Covariances are diagonals of equal variances; 0 says "unknown", as in ROS.
"""

from collections.abc import Callable, Iterable, Sequence
from math import inf, isfinite, nan, sqrt
from struct import Struct
from typing import Any, NamedTuple

from hil.transport.cdr import HEADER, Layout, MalformedError, Reader, Writer, diagonal, tolerant, zero_terminated
from sim.sensors.samples import DvlSample, ImuSample, OdometrySample, PressureSample, Quaternion, Vector3

Status = tuple[str, int, str, dict[str, str]]  # name, level (0 ok, 1 warning, 2 error, 3 stale), message, values

_NS_PER_S = 1_000_000_000
_HALF_SQRT = sqrt(0.5)
NO_DATA = -1.0  # first element of a covariance whose measurement is missing, as sensor_msgs/Imu has it

_TWIST = Layout("6d")
_IMU = Layout("i I string 4d 72s 3d 72s 3d 72s")
_ODOMETRY = Layout("i I string string 7d 288s 6d 288s")
_TWIST_COVARIANCE = Layout("i I string 6d 288s")
_PRESSURE = Layout("i I string 2d")
RANGE = Layout("i I string B 5f")
_RANGE_HUMBLE = Layout("i I string B 4f")
_FLOAT64 = Struct("<d")
_ATTACHMENT = Struct("<qqB16s")


class Attachment(NamedTuple):
    """What rmw_zenoh adds to every message: its number from its publisher `gid`, and when it was sent (ns, wall)."""

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
    """The attitude (w, x, y, z) of FRD in NED to that of FLU in ENU, or back.

    The half turn of the world about its north-east diagonal, the attitude, the half turn of the body about
    its x axis: three quaternions multiplied out.
    """
    w, x, y, z = quaternion
    return _HALF_SQRT * (w + z), _HALF_SQRT * (x + y), _HALF_SQRT * (x - y), _HALF_SQRT * (w - z)


def encode_twist(linear: Sequence[float], angular: Sequence[float]) -> bytes:
    """geometry_msgs/Twist of body velocities: `linear` m/s and `angular` rad/s along FRD."""
    return _TWIST.struct().pack(HEADER, *swap_body(linear), *swap_body(angular))


@tolerant
def decode_twist(data: bytes) -> tuple[Vector3, Vector3]:
    """Linear (m/s) and angular (rad/s) velocity along FRD. What is not finite counts as malformed."""
    values = _TWIST.unpack(data)[1:]
    if not all(map(isfinite, values)):
        raise MalformedError("not a velocity")
    return swap_body(values[:3]), swap_body(values[3:])


def encode_imu(
    sample: ImuSample, frame: str = "imu_link", variances: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> bytes:
    """sensor_msgs/Imu. `variances`: of attitude rad², angular velocity (rad/s)², acceleration (m/s²)²."""
    time_ns, orientation, angular_velocity, acceleration = sample
    w, x, y, z = swap_attitude(orientation)
    attitude, rate, force = variances
    return pack_stamped(
        _IMU, time_ns, (frame,),
        x, y, z, w, diagonal(3, attitude, attitude),
        *swap_body(angular_velocity), diagonal(3, rate, rate),
        *swap_body(acceleration), diagonal(3, force, force),
    )  # fmt: skip


@tolerant
def decode_imu(data: bytes) -> ImuSample:
    """The sample in NED and FRD; covariances are left."""
    time_ns, (x, y, z, w, _, p, q, r, _, ax, ay, az, _) = unpack_stamped(_IMU, data)
    return ImuSample(time_ns, swap_attitude((w, x, y, z)), swap_body((p, q, r)), swap_body((ax, ay, az)))


def encode_dvl(sample: DvlSample, frame: str = "dvl_link", variance: float = 0.0) -> bytes:
    """geometry_msgs/TwistWithCovarianceStamped of a velocity log. `variance`: of the velocity, (m/s)².

    Without bottom lock the velocity is NaN and the first covariance -1. The angular part is always empty.
    """
    velocity = swap_body(sample.velocity) if sample.locked else (nan, nan, nan)
    covariance = diagonal(6, variance if sample.locked else NO_DATA, 0.0)
    return pack_stamped(_TWIST_COVARIANCE, sample.time_ns, (frame,), *velocity, 0.0, 0.0, 0.0, covariance)


@tolerant
def decode_dvl(data: bytes) -> DvlSample:
    """The velocity along FRD and whether it is locked. The altitude is NaN: it travels as a Range."""
    time_ns, (u, v, w, _, _, _, covariance) = unpack_stamped(_TWIST_COVARIANCE, data)
    locked = isfinite(u + v + w) and _FLOAT64.unpack_from(covariance)[0] >= 0.0
    return DvlSample(time_ns, swap_body((u, v, w)), nan, locked)


def encode_range(
    sample: DvlSample, frame: str = "dvl_link", limits: tuple[float, float] = (0.2, 75.0), variance: float = 0.0
) -> bytes:
    """sensor_msgs/Range of the altitude, `limits` m of the device; +inf (REP 117) without bottom lock.

    `variance` in m². The field of view is sent as 0: the mean of narrow beams.
    """
    altitude = sample.altitude if sample.locked else inf
    return pack_stamped(RANGE, sample.time_ns, (frame,), 0, 0.0, *limits, altitude, variance)


@tolerant
def decode_range(data: bytes) -> tuple[int, float]:
    """Time (ns) and range (m); reads the message of Jazzy and the shorter one of Humble."""
    time_ns, (_, _, _, _, distance) = unpack_stamped(_RANGE_HUMBLE, data)
    return time_ns, distance


def encode_pressure(sample: PressureSample, frame: str = "pressure_link", variance: float = 0.0) -> bytes:
    """sensor_msgs/FluidPressure: absolute pressure. `variance` in Pa²."""
    return pack_stamped(_PRESSURE, sample.time_ns, (frame,), sample.pascal, variance)


@tolerant
def decode_pressure(data: bytes) -> PressureSample:
    """The absolute pressure in Pa."""
    time_ns, (pascal, _) = unpack_stamped(_PRESSURE, data)
    return PressureSample(time_ns, pascal)


def encode_odometry(
    sample: OdometrySample,
    frame: str = "odom",
    child: str = "base_link",
    variances: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0),
) -> bytes:
    """nav_msgs/Odometry: pose in the world `frame`, velocities along the body `child`.

    `variances`: of position m², attitude rad², velocity (m/s)², angular velocity (rad/s)².
    """
    w, x, y, z = swap_attitude(sample.orientation)
    position, attitude, velocity, rate = variances
    return pack_stamped(
        _ODOMETRY, sample.time_ns, (frame, child),
        *swap_world(sample.position), x, y, z, w, diagonal(6, position, attitude),
        *swap_body(sample.nu[:3]), *swap_body(sample.nu[3:]), diagonal(6, velocity, rate),
    )  # fmt: skip


@tolerant
def decode_odometry(data: bytes) -> OdometrySample:
    """The sample in NED and FRD; covariances are left."""
    time_ns, (east, north, up, x, y, z, w, _, *nu, _) = unpack_stamped(_ODOMETRY, data)
    return OdometrySample(
        time_ns, swap_world((east, north, up)), swap_attitude((w, x, y, z)), swap_body(nu[:3]) + swap_body(nu[3:])
    )


def pack_stamped(layout: Layout, time_ns: int, names: tuple[str, ...], *values: Any) -> bytes:
    """A message that begins with a std_msgs/Header: the stamp, then frame names, then `values`."""
    strings: list[Any] = []
    for name in map(zero_terminated, names):
        strings += len(name), name
    return layout.struct(*strings[::2]).pack(HEADER, *divmod(time_ns, _NS_PER_S), *strings, *values)


def unpack_stamped(layout: Layout, data: bytes) -> tuple[int, tuple[Any, ...]]:
    """Time in ns and the values behind the frame names."""
    values = layout.unpack(data)
    return values[1] * _NS_PER_S + values[2], values[3 + 2 * layout.strings :]


def encode_int64_array(values: Sequence[int]) -> bytes:
    """std_msgs/Int64MultiArray of one plain row."""
    writer = Writer()
    writer.numbers("I", 0, 0, len(values))  # no dimensions named, no offset
    writer.numbers("q", *values)
    return bytes(writer.data)


@tolerant
def decode_int64_array(data: bytes) -> tuple[int, ...]:
    """The values; the names of dimensions are left."""
    reader = Reader(data)
    for _ in range(reader.count()):
        reader.string()
        reader.numbers("I", 2)
    reader.count()
    return reader.numbers("q", reader.count())


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
    """The statuses; stamp and hardware are left."""
    reader = Reader(data)
    reader.numbers("I", 2)
    reader.string()
    return [_status(reader) for _ in range(reader.count())]


def _status(reader: Reader) -> Status:
    (level,) = reader.numbers("B")
    name, message, _ = reader.string(), reader.string(), reader.string()
    return name, level, message, {reader.string(): reader.string() for _ in range(reader.count())}


def data_key(domain: int, topic: str, type_name: str, type_hash: str) -> str:
    """The zenoh key of a topic: data_key(0, "/imu", "sensor_msgs/msg/Imu", "RIHS01_…")."""
    package, kind, name = type_name.split("/")
    return f"{domain}/{topic.strip('/')}/{package}::{kind}::dds_::{name}_/{type_hash}"


def pack_attachment(sequence: int, time_ns: int, gid: bytes) -> bytes:
    """The 33 bytes beside a message; `sequence` from 1, `time_ns` of the wall clock, `gid` 16 bytes."""
    return _ATTACHMENT.pack(sequence, time_ns, 16, gid)


def unpack_attachment(data: bytes) -> Attachment | None:
    """What `pack_attachment` packed, or None if that is not it."""
    if len(data) != _ATTACHMENT.size:
        return None
    sequence, time_ns, length, gid = _ATTACHMENT.unpack(data)
    return Attachment(sequence, time_ns, gid) if length == 16 else None


Encoded = Iterable[tuple[str, bytes]]
Encoder = Callable[[Any], Encoded]
Decoder = Callable[[bytes], Any]


def encoder(topic: str) -> Encoder:
    """What turns the simulator's samples called `topic` into messages, each with the topic it goes out on."""
    return _ENCODERS.get(topic) or _sensors().ENCODERS[topic]


def decoder(topic: str) -> Decoder | None:
    """What turns a message on one of the topics of `hil.topics` into our records; None for another topic."""
    return _DECODERS.get(topic) or _sensors().DECODERS.get(topic)


def _sensors() -> Any:
    from hil.transport import ros_sensors  # most vehicles do without, and start sooner

    return ros_sensors


_ENCODERS: dict[str, Encoder] = {
    "imu": lambda sample: [("imu", encode_imu(sample))],
    "dvl": lambda sample: [("dvl", encode_dvl(sample)), ("altitude", encode_range(sample))],
    "pressure": lambda sample: [("pressure", encode_pressure(sample))],
    "odom": lambda sample: [("odom", encode_odometry(sample))],
    "ground_truth": lambda sample: [("ground_truth", encode_odometry(sample, frame="map"))],
}
_DECODERS: dict[str, Decoder] = {
    "cmd_vel": decode_twist,
    "trace": decode_int64_array,
    "imu": decode_imu,
    "dvl": decode_dvl,
    "altitude": decode_range,
    "pressure": decode_pressure,
    "odom": decode_odometry,
    "ground_truth": decode_odometry,
    "diagnostics": decode_diagnostics,
}
