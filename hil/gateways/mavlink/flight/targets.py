"""Targets of companion software: SET_POSITION_TARGET_LOCAL_NED and _GLOBAL_INT, SET_ATTITUDE_TARGET."""

from math import isfinite
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.autonomy.control.controller import heading_of
from hil.client.samples import State
from hil.gateways.mavlink.flight.guidance import Point, in_body, in_world
from hil.gateways.mavlink.snapshot import Origin
from hil.ros.commands import MAX_DEPTH, MAX_PLACE
from sim.geodesy import TangentPlane

NO_POSITION, NO_DEPTH, NO_VELOCITY, NO_ACCELERATION = 0b11, 0b100, 0b111000, 0b111000000
FORCE, NO_YAW, NO_YAW_RATE = 1 << 9, 1 << 10, 1 << 11
NO_BODY_YAW_RATE, NO_THRUST, NO_ATTITUDE = 1 << 2, 1 << 6, 1 << 7
MAX_SPEED = 20.0  # m/s, rad/s
GLOBAL_FRAMES = {
    dialect.MAV_FRAME_GLOBAL: False, dialect.MAV_FRAME_GLOBAL_INT: False,
    dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT: True, dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT: True,
}  # fmt: skip
BODY_FRAMES = (dialect.MAV_FRAME_BODY_NED, dialect.MAV_FRAME_BODY_OFFSET_NED, dialect.MAV_FRAME_BODY_FRD)
LOCAL_FRAMES = (dialect.MAV_FRAME_LOCAL_NED, dialect.MAV_FRAME_LOCAL_OFFSET_NED, *BODY_FRAMES)


class Target(NamedTuple):
    """Request of companion software: a `position` (m, NED) or a velocity (m/s, FRD), each with heading or turn rate."""

    position: Point | None = None
    velocity: tuple[float, float, float] | None = None
    heading: float | None = None
    yaw_rate: float = 0.0
    speed: float | None = None  # m/s at most on the way to `position`
    is_hold: bool = False  # a depth or an attitude alone, which the modes that hold those take, too


class TargetError(Exception):
    """A target that is invalid, or that the vehicle cannot follow."""


def local_target(packet: Any, state: State) -> Target:
    """Return the target of a SET_POSITION_TARGET_LOCAL_NED. Raises TargetError."""
    frame = packet.coordinate_frame
    if frame not in LOCAL_FRAMES:
        raise TargetError(f"frame {frame} is not supported")
    _require_finite(packet, (packet.x, packet.y, packet.z))
    mask = packet.type_mask
    position = None
    if not mask & NO_POSITION or not mask & NO_DEPTH:
        north, east, depth = packet.x, packet.y, packet.z
        if frame in BODY_FRAMES:
            north, east = in_world(north, east, state.heading)
        if frame != dialect.MAV_FRAME_LOCAL_NED:
            north, east, depth = [a + b for a, b in zip((north, east, depth), state.position, strict=True)]
        position = _fill_ignored(mask, (north, east, depth), state)
    return _target(packet, position, state, frame in BODY_FRAMES)


def global_target(packet: Any, state: State, origin: Origin | None, home_depth: float) -> Target:
    """Return the target of a SET_POSITION_TARGET_GLOBAL_INT. Raises TargetError, also without an origin."""
    relative = GLOBAL_FRAMES.get(packet.coordinate_frame)
    if relative is None:
        raise TargetError(f"frame {packet.coordinate_frame} is not supported")
    _require_finite(packet, (packet.alt,))
    target_position = None
    if not packet.type_mask & NO_POSITION or not packet.type_mask & NO_DEPTH:
        position = state.position
        if not packet.type_mask & NO_POSITION:
            position = earth_position(packet.lat_int, packet.lon_int, 0.0, origin)
        target_position = _fill_ignored(
            packet.type_mask, (position[0], position[1], depth_of(packet.alt, relative, origin, home_depth)), state
        )
    return _target(packet, target_position, state, False)


def attitude_target(packet: Any, speed_up: float) -> Target:
    """Return the target of a SET_ATTITUDE_TARGET: heading or turn rate, and `speed_up` (m/s) at full thrust.

    Raises TargetError.
    """
    mask = packet.type_mask
    used = [*([] if mask & NO_ATTITUDE else packet.q), packet.body_yaw_rate, packet.thrust]
    if not all(isfinite(value) for value in used) or abs(packet.body_yaw_rate) > MAX_SPEED:
        raise TargetError("a number is not finite, or faster than the vehicle")
    if mask & NO_ATTITUDE and mask & NO_BODY_YAW_RATE:
        raise TargetError("type_mask ignores everything")
    heading = None if mask & NO_ATTITUDE else heading_of(packet.q)
    yaw_rate = packet.body_yaw_rate if heading is None else 0.0
    up = 0.0 if mask & NO_THRUST else (min(max(packet.thrust, 0.0), 1.0) - 0.5) * 2.0 * speed_up
    return Target(None, (0.0, 0.0, -up), heading, yaw_rate, None, heading is not None)


def earth_position(latitude_e7: float, longitude_e7: float, depth: float, origin: Origin | None) -> Point:
    """Return the place (m, NED) of a latitude and longitude (1e-7 degrees). Raises TargetError without an origin."""
    if origin is None:
        raise TargetError("the vehicle has no origin: its world has none, or send SET_GPS_GLOBAL_ORIGIN")
    if not (abs(latitude_e7) <= 90e7 and abs(longitude_e7) <= 180e7):
        raise TargetError("no such latitude and longitude")
    north, east, _ = TangentPlane(origin.latitude, origin.longitude, origin.altitude).local(
        latitude_e7 * 1e-7, longitude_e7 * 1e-7, origin.altitude
    )
    if max(abs(north), abs(east)) > MAX_PLACE:
        raise TargetError(f"further than {MAX_PLACE / 1000.0:g} km away")
    return north, east, depth


def depth_of(altitude: float, relative: bool, origin: Origin | None, home_depth: float) -> float:
    """Return the depth (m) of an altitude (m) above home, or above the sea."""
    if relative:
        return home_depth - altitude
    return (origin.altitude if origin else 0.0) - altitude


def _fill_ignored(mask: int, position: Point, state: State) -> Point:
    """Return a place whose ignored parts are those of now. Raises TargetError."""
    north, east = state.position[:2] if mask & NO_POSITION else position[:2]
    depth = state.depth if mask & NO_DEPTH else position[2]
    if not (abs(north) <= MAX_PLACE and abs(east) <= MAX_PLACE and -MAX_DEPTH <= depth <= MAX_DEPTH):
        raise TargetError("the place is further than any vehicle goes")
    return north, east, max(0.0, depth)


def _target(packet: Any, position: Point | None, state: State, in_body_frame: bool) -> Target:
    mask = packet.type_mask
    if mask & NO_ACCELERATION != NO_ACCELERATION:
        raise TargetError("accelerations and forces are not supported: ignore them in type_mask")
    has_velocity = mask & NO_VELOCITY != NO_VELOCITY
    heading = None if mask & NO_YAW else packet.yaw + (state.heading if in_body_frame else 0.0)
    yaw_rate = 0.0 if mask & NO_YAW_RATE else packet.yaw_rate
    if position is not None:
        return Target(position, None, heading, 0.0, None, bool(mask & NO_POSITION) and not has_velocity)
    if not has_velocity:
        if heading is None and not yaw_rate:
            raise TargetError("type_mask ignores everything")
        return Target(None, (0.0, 0.0, 0.0), heading, yaw_rate)
    x, y, z = [0.0 if mask & 1 << 3 + axis else value for axis, value in enumerate((packet.vx, packet.vy, packet.vz))]
    if not in_body_frame:
        x, y = in_body(x, y, state.heading)
    return Target(None, (x, y, z), heading, yaw_rate)


def _require_finite(packet: Any, position: tuple[float, ...]) -> None:
    """Raise TargetError for invalid numbers; those that the mask ignores are not checked."""
    mask = packet.type_mask
    speeds = [
        *((packet.vx, packet.vy, packet.vz) if mask & NO_VELOCITY != NO_VELOCITY else ()),
        *(() if mask & NO_YAW_RATE else (packet.yaw_rate,)),
    ]
    places = position if not mask & NO_POSITION or not mask & NO_DEPTH else ()
    if not all(isfinite(value) for value in (*places, *speeds, *(() if mask & NO_YAW else (packet.yaw,)))):
        raise TargetError("a number is not finite")
    if any(abs(value) > MAX_SPEED for value in speeds):
        raise TargetError(f"faster than {MAX_SPEED:g} m/s or rad/s")
