"""Encode and decode actuators: joints and accessories in sensor_msgs/JointState, motors in a Float64MultiArray."""

from collections.abc import Mapping, Sequence
from math import isfinite
from typing import NamedTuple

from hil.ros.cdr import MalformedError, tolerant
from hil.ros.encoders import Decoder
from hil.ros.message import encode, header, read, time_of
from sim.vehicle.accessories import NAMES
from sim.vehicle.vehicle import Vehicle

_TYPE = "sensor_msgs/msg/JointState"
_ROW = "std_msgs/msg/Float64MultiArray"


class JointStates(NamedTuple):
    """Thrusters, fins, azimuths of thrusters, with their `names` as channels; those of the URDF's joints, but azimuths.

    `efforts` are the thrusts (N), positive along the thrusters' axes; 0 for others. `positions` are the angles of fins
    and azimuths (rad); 0 for a thruster, whose shaft angle is not simulated. Empty positions mean unknown.
    """

    time_ns: int
    names: tuple[str, ...]
    efforts: tuple[float, ...]
    positions: tuple[float, ...] = ()


def joint_states(time_ns: int, vehicle: Vehicle, thrusts: Sequence[float], deflections: Sequence[float]) -> JointStates:
    """Return the joints of a vehicle from its thrusts (N) and the angles of fins and azimuths (rad)."""
    names = vehicle.channels[: len(thrusts) + len(deflections)]
    efforts, positions = [*thrusts, *[0.0] * len(deflections)], [*[0.0] * len(thrusts), *deflections]
    return JointStates(time_ns, tuple(names), tuple(efforts), tuple(positions))


def encode_joints(states: JointStates) -> bytes:
    """Encode sensor_msgs/JointState without a frame and velocities."""
    head, names, positions = header(states.time_ns), states.names, states.positions
    return encode(_TYPE, {"header": head, "name": names, "position": positions, "effort": states.efforts})


@tolerant
def decode_joints(data: bytes) -> JointStates:
    """Return the joints in a message; different numbers of names and values count as malformed."""
    message = read(_TYPE, data)
    names, efforts, positions = message["name"], message["effort"], message["position"]
    if len(efforts) != len(names) or len(positions) not in (0, len(names)):
        raise MalformedError("not a value for each joint")
    return JointStates(time_of(message), tuple(names), efforts, positions)


def encode_accessories(time_ns: int, shares: Mapping[str, float]) -> bytes:
    """Encode sensor_msgs/JointState with the shares of accessories (sim/vehicle/accessories.py) as positions."""
    return encode(_TYPE, {"header": header(time_ns), "name": tuple(shares), "position": tuple(shares.values())})


@tolerant
def decode_accessories(data: bytes) -> dict[str, float]:
    """Return the share of each accessory in a message; unknown names count as malformed."""
    message = read(_TYPE, data)
    names, shares = message["name"], message["position"]
    if len(names) != len(shares) or not {*names} <= {*NAMES} or not all(map(isfinite, shares)):
        raise MalformedError("not a share for each accessory")
    return dict(zip(names, shares, strict=True))


class MotorState(NamedTuple):
    """One channel: its present pulse width (us), rotor speed (rad/s, with the sign of its thrust) and current (A).

    Speed and current are nan if the thruster's model does not have them, and for fins.
    """

    pulse_us: float
    speed: float
    current: float


def encode_motors(motors: Sequence[MotorState]) -> bytes:
    """Encode std_msgs/Float64MultiArray with a row a channel; the label of its second dimension names the columns."""
    columns = len(MotorState._fields)
    rows = {"label": "channel", "size": len(motors), "stride": columns * len(motors)}
    row = {"label": ",".join(MotorState._fields), "size": columns, "stride": columns}
    values = [float(value) for motor in motors for value in motor]
    return encode(_ROW, {"layout": {"dim": [rows, row], "data_offset": 0}, "data": values})


@tolerant
def decode_motors(data: bytes) -> tuple[MotorState, ...]:
    """Return the motors in a message; incomplete rows count as malformed."""
    values = read(_ROW, data)["data"]
    columns = len(MotorState._fields)
    if len(values) % columns:
        raise MalformedError("not a whole row for each channel")
    return tuple([MotorState(*values[start : start + columns]) for start in range(0, len(values), columns)])


DECODERS: dict[str, Decoder] = {
    "joint_states": decode_joints, "motors": decode_motors,
    **dict.fromkeys(("accessories", "cmd_accessories"), decode_accessories),
}  # fmt: skip
