"""ROS 2 messages of all other sensors; frames and rules are those of hil.ros.encoders."""

from collections.abc import Callable
from math import isfinite, nan

from hil.common.vectors import Vector3
from hil.ros import encoders as ros
from hil.ros.cdr import HEADER, Layout, diagonal, tolerant
from hil.ros.encoders import NO_DATA, pack_stamped, swap_body, swap_world, unpack_stamped
from hil.ros.message import Message, encode, header, read, time_of
from sim.sensors import extra_samples
from sim.sensors.samples import Covariance

# Constants of the messages.
_NO_FIX, _HAS_FIX, _SERVICE_GPS = -1, 0, 1
_COVARIANCE_UNKNOWN, _COVARIANCE_DIAGONAL_KNOWN = 0, 2
_DISCHARGING, _NOT_CHARGING = 2, 3
_GOOD, _DEAD = 1, 3
_LITHIUM_ION = 2

_BATTERY, _FIX = "sensor_msgs/msg/BatteryState", "sensor_msgs/msg/NavSatFix"
_POSE, _TWIST = "geometry_msgs/msg/PoseWithCovarianceStamped", "geometry_msgs/msg/TwistStamped"
_BOOL = Layout("B")
_FIELD = Layout("i I string 3d 72s")


def encode_bool(sample: extra_samples.FlagSample) -> bytes:
    """Encode std_msgs/Bool, which has no stamp."""
    return _BOOL.struct().pack(HEADER, sample.on)


@tolerant
def decode_bool(data: bytes) -> bool:
    """Return the value of the switch."""
    return bool(_BOOL.unpack(data)[1])


def encode_distance(sample: extra_samples.RangeSample, frame: str = "altimeter_link", variance: float = 0.0) -> bytes:
    """Encode sensor_msgs/Range of one narrow sonar beam; +inf and -inf as in REP 117. `variance` in m²."""
    return ros.pack_range(sample.time_ns, (frame,), 0, 0.0, *sample.limits, sample.distance, variance)


@tolerant
def decode_distance(data: bytes) -> extra_samples.RangeSample:
    """Return distance and limits of the device, which are sent as 32-bit floats."""
    time_ns, (_, _, near, far, distance) = unpack_stamped(ros.RANGE_HUMBLE, data)
    return extra_samples.RangeSample(time_ns, distance, (near, far))


def encode_field(
    sample: extra_samples.FieldSample, frame: str = "magnetometer_link", variance: float = 0.0, z: float | None = None
) -> bytes:
    """Encode sensor_msgs/MagneticField along FLU, in tesla. `variance` of a component in T²; `z`: that of the third."""
    field = swap_body(sample.field)
    return pack_stamped(_FIELD, sample.time_ns, (frame,), *field, diagonal(3, variance, 0.0, z))


@tolerant
def decode_field(data: bytes) -> extra_samples.FieldSample:
    """Return the field along FRD, without covariance."""
    time_ns, (x, y, z, _) = unpack_stamped(_FIELD, data)
    return extra_samples.FieldSample(time_ns, swap_body((x, y, z)))


def encode_velocity(sample: extra_samples.VelocitySample, frame: str = "current_meter_link") -> bytes:
    """Encode geometry_msgs/TwistStamped of a velocity along FLU; the angular part is always 0."""
    u, v, w = swap_body(sample.velocity)
    return encode(_TWIST, {"header": header(sample.time_ns, frame), "twist": {"linear": {"x": u, "y": v, "z": w}}})


@tolerant
def decode_velocity(data: bytes) -> extra_samples.VelocitySample:
    """Return the linear velocity along FRD."""
    message = read(_TWIST, data)
    return extra_samples.VelocitySample(time_of(message), swap_body(_vector(message["twist"]["linear"])))


def encode_fix(sample: extra_samples.FixSample, frame: str = "gps_link") -> bytes:
    """Encode sensor_msgs/NavSatFix. Without a fix: status -1, position NaN and covariance unknown."""
    horizontal, vertical = sample.variances if sample.fix else (0.0, 0.0)
    return encode(_FIX, {
        "header": header(sample.time_ns, frame),
        "status": {"status": _HAS_FIX if sample.fix else _NO_FIX, "service": _SERVICE_GPS},
        "latitude": sample.latitude if sample.fix else nan, "longitude": sample.longitude if sample.fix else nan,
        "altitude": sample.altitude if sample.fix else nan,
        "position_covariance": (horizontal, 0.0, 0.0, 0.0, horizontal, 0.0, 0.0, 0.0, vertical),
        "position_covariance_type": _COVARIANCE_DIAGONAL_KNOWN if sample.fix else _COVARIANCE_UNKNOWN,
    })  # fmt: skip


@tolerant
def decode_fix(data: bytes) -> extra_samples.FixSample:
    """Return the fix, with the first and last diagonal element of its covariance."""
    message = read(_FIX, data)
    place = message["latitude"], message["longitude"], message["altitude"]
    first, *_, last = message["position_covariance"]
    is_fix = message["status"]["status"] >= _HAS_FIX and isfinite(sum(place))
    latitude, longitude, altitude = place if is_fix else (nan, nan, nan)
    return extra_samples.FixSample(time_of(message), latitude, longitude, altitude, (first, last), is_fix)


def encode_position(sample: extra_samples.PositionSample, frame: str = "map") -> bytes:
    """Encode geometry_msgs/PoseWithCovarianceStamped of a position in the world `frame`.

    Among the stamped messages with a position only this one has a covariance, which filters need. The orientation is
    not measured: it is the identity (level, facing east), with variances -1.
    """
    values = [0.0] * 36
    for row in range(3):
        values[6 * row : 6 * row + 3] = _swap_covariance(sample.covariance)[3 * row : 3 * row + 3]
        values[7 * row + 21] = NO_DATA
    east, north, up = swap_world(sample.position)
    pose = {"position": {"x": east, "y": north, "z": up}}
    return encode(_POSE, {"header": header(sample.time_ns, frame), "pose": {"pose": pose, "covariance": values}})


@tolerant
def decode_position(data: bytes) -> extra_samples.PositionSample:
    """Return the position, NED, with its covariance; the orientation is ignored."""
    message = read(_POSE, data)
    pose, covariance = message["pose"]["pose"], message["pose"]["covariance"]
    a, b, c, _, _, _, d, e, f, _, _, _, g, h, i, *_ = covariance
    place = swap_world(_vector(pose["position"]))
    return extra_samples.PositionSample(time_of(message), place, _swap_covariance((a, b, c, d, e, f, g, h, i)))


def _vector(of: Message) -> Vector3:
    """Return a geometry_msgs/Point or Vector3 as a tuple."""
    return of["x"], of["y"], of["z"]


def _swap_covariance(of: Covariance) -> Covariance:
    """Return a position's covariance converted from NED to ENU or back."""
    xx, xy, xz, yx, yy, yz, zx, zy, zz = of
    return yy, yx, -yz, xy, xx, -xz, -zy, -zx, zz


def encode_battery(sample: extra_samples.BatterySample, frame: str = "battery_link") -> bytes:
    """Encode sensor_msgs/BatteryState; the current is negative while discharging; health is "dead" after a cut-off."""
    status, health = (_NOT_CHARGING, _DEAD) if sample.cut_off else (_DISCHARGING, _GOOD)
    charge = {"charge": sample.charge, "capacity": sample.capacity, "design_capacity": sample.capacity}
    supply = {"power_supply_status": status, "power_supply_health": health, "power_supply_technology": _LITHIUM_ION}
    return encode(_BATTERY, {
        "header": header(sample.time_ns, frame), "voltage": sample.voltage, "temperature": nan,
        "current": -sample.current, **charge, "percentage": sample.charge / sample.capacity, **supply, "present": True,
    })  # fmt: skip


@tolerant
def decode_battery(data: bytes) -> extra_samples.BatterySample:
    """Return the battery; cells, location and serial number are ignored."""
    message = read(_BATTERY, data)
    voltage, current, charge, capacity = [message[key] for key in ("voltage", "current", "charge", "capacity")]
    return extra_samples.BatterySample(
        time_of(message), voltage, -current, charge, capacity, message["power_supply_health"] == _DEAD
    )


def _framed(encode: Callable[..., bytes]) -> ros.Encoder:
    """Return the encoder of a topic whose frame has the topic's name."""
    return lambda sample, prefix, *variances, name: [(name, encode(sample, f"{prefix}{name}_link", *variances))]


# By the type of message.
ENCODERS: dict[str, ros.Encoder] = {
    "sensor_msgs/msg/Imu": _framed(lambda sample, frame, *of: ros.encode_imu(sample, frame, *([of] if of else []))),
    "sensor_msgs/msg/Range": _framed(encode_distance),
    "sensor_msgs/msg/MagneticField": _framed(encode_field),
    "std_msgs/msg/Bool": _framed(lambda sample, _: encode_bool(sample)),
    _BATTERY: _framed(encode_battery),
    _FIX: _framed(encode_fix),
    _POSE: _framed(lambda sample, _: encode_position(sample)),
    _TWIST: _framed(encode_velocity),
}
DECODERS: dict[str, ros.Decoder] = {
    "sensor_msgs/msg/Imu": ros.decode_imu,
    "sensor_msgs/msg/Range": decode_distance,
    "sensor_msgs/msg/MagneticField": decode_field,
    "std_msgs/msg/Bool": decode_bool,
    _BATTERY: decode_battery,
    _FIX: decode_fix,
    _POSE: decode_position,
    _TWIST: decode_velocity,
}
