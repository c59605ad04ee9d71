"""Items of a mission: which commands are known, and where they lead."""

from math import isfinite, nan, radians
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.gateways.mavlink.flight.guidance import Point
from hil.gateways.mavlink.flight.targets import GLOBAL_FRAMES, TargetError, depth_of, earth_position
from hil.gateways.mavlink.snapshot import Origin
from hil.ros.commands import MAX_DEPTH

WAYPOINTS = (
    dialect.MAV_CMD_NAV_WAYPOINT, dialect.MAV_CMD_NAV_SPLINE_WAYPOINT, dialect.MAV_CMD_NAV_LOITER_UNLIM,
    dialect.MAV_CMD_NAV_LOITER_TIME,
)  # fmt: skip
WITHOUT_PLACE = (
    dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH, dialect.MAV_CMD_NAV_LAND, dialect.MAV_CMD_DO_CHANGE_SPEED,
)  # fmt: skip
# Ground stations put these in missions: takeoffs, and commands for cameras and mounts. They are passed over.
IDLE_COMMANDS = {
    dialect.MAV_CMD_NAV_TAKEOFF, *range(dialect.MAV_CMD_DO_SET_MODE, dialect.MAV_CMD_DO_LAST + 1), *range(530, 535),
    1000, 1001, 2000, 2001, 2500, 2501,
} - {dialect.MAV_CMD_DO_JUMP}  # fmt: skip
LOCAL = dialect.MAV_FRAME_LOCAL_NED


class Item(NamedTuple):
    """One item as it is on the wire; x and y are in 1e-7 degrees, or 1e-4 m in a local frame; z in m."""

    frame: int
    command: int
    params: tuple[float, float, float, float]
    x: int
    y: int
    z: float
    autocontinue: bool = True


def read_item(packet: Any) -> Item | None:
    """Return the item of a MISSION_ITEM_INT or MISSION_ITEM; None for invalid numbers."""
    x, y, z = packet.x, packet.y, packet.z
    if packet.get_msgId() == dialect.MAVLINK_MSG_ID_MISSION_ITEM:
        scale = 1e4 if packet.frame == LOCAL else 1e7
        if not (isfinite(x) and isfinite(y) and abs(x * scale) < 2**31 and abs(y * scale) < 2**31):
            return None
        x, y = round(x * scale), round(y * scale)
    if not isfinite(z) and packet.command in WAYPOINTS:
        return None
    params = packet.param1, packet.param2, packet.param3, packet.param4
    return Item(packet.frame, packet.command, params, x, y, z if isfinite(z) else 0.0, packet.autocontinue != 0)


def validate_item(item: Item, origin: Origin | None) -> int | None:
    """Return why an item cannot be flown as a MAV_MISSION_RESULT, None if it can."""
    if item.command in WAYPOINTS:
        if item.frame != LOCAL and item.frame not in GLOBAL_FRAMES:
            return int(dialect.MAV_MISSION_UNSUPPORTED_FRAME)
        try:
            position_of(item, origin, 0.0)
        except TargetError:
            return int(dialect.MAV_MISSION_INVALID_PARAM5_X)
        return None
    if item.command == dialect.MAV_CMD_DO_CHANGE_SPEED:
        return None if isfinite(item.params[1]) else int(dialect.MAV_MISSION_INVALID_PARAM2)
    if item.command in WITHOUT_PLACE or item.command in IDLE_COMMANDS:
        return None
    return int(dialect.MAV_MISSION_UNSUPPORTED)


def position_of(item: Item, origin: Origin | None, home_depth: float) -> Point:
    """Return where an item lies (m, NED). Raises TargetError without an origin for a place on the earth."""
    if item.frame == LOCAL:
        position = item.x * 1e-4, item.y * 1e-4, item.z
    else:
        depth = depth_of(item.z, GLOBAL_FRAMES[item.frame], origin, home_depth)
        position = earth_position(item.x, item.y, depth, origin)
    if not abs(position[2]) <= MAX_DEPTH:  # its numbers of x and y reach no further than MAX_PLACE
        raise TargetError("further than any vehicle goes")
    return position[0], position[1], max(0.0, position[2])


def heading_of_item(item: Item) -> float | None:
    """Return the heading (rad) that a waypoint asks for, None if it leaves that open, by nan or, as ArduPilot, by 0."""
    yaw = item.params[3]
    return radians(yaw) if isfinite(yaw) and yaw != 0.0 else None


def wait_of(item: Item) -> float:
    """Return how long (s) to stay at a waypoint."""
    seconds = item.params[0]
    if item.command == dialect.MAV_CMD_NAV_LOITER_UNLIM:
        return float("inf")
    return seconds if isfinite(seconds) and seconds > 0.0 else 0.0


def radius_of(item: Item, default: float) -> float:
    """Return from how many m a waypoint counts as reached."""
    radius = item.params[1] if item.command == dialect.MAV_CMD_NAV_WAYPOINT else nan
    return min(radius, 100.0) if isfinite(radius) and radius > 0.0 else default


def encode_item(item: Item, index: int, current: bool, system: int, component: int, as_int: bool) -> Any:
    """Return the MISSION_ITEM_INT of an item, or its old form MISSION_ITEM."""
    scale = 1e-4 if item.frame == LOCAL else 1e-7
    x, y = (item.x, item.y) if as_int else (item.x * scale, item.y * scale)
    kind = dialect.MAVLink_mission_item_int_message if as_int else dialect.MAVLink_mission_item_message
    return kind(
        system, component, index, item.frame, item.command, int(current), int(item.autocontinue), *item.params, x, y,
        item.z, dialect.MAV_MISSION_TYPE_MISSION,
    )  # fmt: skip
