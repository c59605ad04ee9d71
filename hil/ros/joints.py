"""Encode and decode sensor_msgs/JointState: the thrust of each thruster, the deflection of each fin."""

from collections.abc import Sequence
from typing import NamedTuple

from hil.ros.cdr import MalformedError, tolerant
from hil.ros.encoders import Decoder, Encoder
from hil.ros.message import encode, header, read, time_of
from sim.vehicle.vehicle import Vehicle

_TYPE = "sensor_msgs/msg/JointState"


class JointStates(NamedTuple):
    """Thrusters, then fins, by their `names` in the vehicle's file, which are those of the URDF's joints.

    `efforts` are the thrusts (N), positive along their axes; 0 for a fin. `positions` are the deflections of fins
    (rad); 0 for a thruster, the angle of whose shaft is not simulated. Empty positions say nothing of them.
    """

    time_ns: int
    names: tuple[str, ...]
    efforts: tuple[float, ...]
    positions: tuple[float, ...] = ()


def joint_states(time_ns: int, vehicle: Vehicle, thrusts: Sequence[float], deflections: Sequence[float]) -> JointStates:
    """Return the joints of a vehicle from its thrusts (N) and the deflections of its fins (rad)."""
    names = [*[thruster.name for thruster in vehicle.thrusters], *[fin.name for fin in vehicle.fins]]
    efforts, positions = [*thrusts, *[0.0] * len(deflections)], [*[0.0] * len(thrusts), *deflections]
    return JointStates(time_ns, tuple(names), tuple(efforts), tuple(positions))


def encode_joints(states: JointStates) -> bytes:
    """sensor_msgs/JointState of no frame, without velocities."""
    head, names, positions = header(states.time_ns), states.names, states.positions
    return encode(_TYPE, {"header": head, "name": names, "position": positions, "effort": states.efforts})


@tolerant
def decode_joints(data: bytes) -> JointStates:
    """Return the joints of a message. One whose names and values differ in number counts as malformed."""
    message = read(_TYPE, data)
    names, efforts, positions = message["name"], message["effort"], message["position"]
    if len(efforts) != len(names) or len(positions) not in (0, len(names)):
        raise MalformedError("not a value for each joint")
    return JointStates(time_of(message), tuple(names), efforts, positions)


ENCODERS: dict[str, Encoder] = {}  # no sensor sends them
DECODERS: dict[str, Decoder] = {"joint_states": decode_joints}
