"""Steering laws of the modes: from what is to be held or reached to a command of the vehicle. Without state of time."""

from math import atan2, cos, dist, hypot, sin

from hil.autonomy.control.controller import HoldGains, VelocityCommand, wrap
from hil.autonomy.control.position import approach
from hil.client.samples import State
from hil.gateways.mavlink.flight.sticks import Sticks
from hil.gateways.mavlink.parameter_table import ParameterTable
from hil.gateways.mavlink.snapshot import Wrench

FAR = 1.0  # m: from there on a vehicle goes bow first
COAST_S = 0.4  # that a vehicle still moves on once a stick is let go
Point = tuple[float, float, float]  # m, NED


def push(sticks: Sticks, parameters: ParameterTable) -> Wrench:
    """Return the wrench (N, N m, FRD) of sticks in Manual."""
    axes = (sticks.x, sticks.y, -sticks.z, sticks.k, sticks.m, sticks.r)
    names = ("FORCE_X", "FORCE_Y", "FORCE_Z", "MOMENT_K", "MOMENT_M", "MOMENT_N")
    x, y, z, k, m, n = [axis * parameters[f"HIL_{name}"] for axis, name in zip(axes, names, strict=True)]
    return x, y, z, k, m, n


class Holds:
    """Depth, heading and place (m, NED) that are held while their sticks are centred; None while they are not."""

    def __init__(self) -> None:
        self.release()

    def release(self) -> None:
        """Hold nothing: each is found again."""
        self.depth: float | None = None
        self.heading: float | None = None
        self.position: tuple[float, float] | None = None

    def hold(self, state: State) -> None:
        """Hold depth, heading and place as they are now."""
        self.release()
        self.drive(Sticks(), state, True, True)

    def drive(self, sticks: Sticks, state: State, holds_depth: bool, holds_place: bool) -> Sticks:
        """Find what is to be held from now on, and release what the sticks move; return the sticks."""
        down = _down(state)
        if sticks.r:
            self.heading = None
        elif self.heading is None:
            self.heading = wrap(state.heading + COAST_S * state.angular_velocity[2])
        if sticks.z or not holds_depth:
            self.depth = None
        elif self.depth is None:
            self.depth = max(0.0, state.depth + COAST_S * down)
        if sticks.x or sticks.y or not holds_place:
            self.position = None
        elif self.position is None:
            north, east = level_velocity(state)
            self.position = state.position[0] + COAST_S * north, state.position[1] + COAST_S * east
        return sticks


def piloted(sticks: Sticks, state: State, holds: Holds, parameters: ParameterTable) -> VelocityCommand:
    """Return the command of sticks in the modes that hold something."""
    surge = sticks.x * parameters["PILOT_SPEED"]
    sway = sticks.y * parameters["PILOT_SPEED"]
    if holds.position:
        gains = _gains(parameters, parameters["WPNAV_SPEED"])
        held = approach((*holds.position, 0.0), 0.0, state.position, state.heading, gains)
        surge, sway = held.surge, held.sway
    most = parameters["PILOT_SPEED_DN" if sticks.z < 0.0 and parameters["PILOT_SPEED_DN"] else "PILOT_SPEED_UP"]
    heave = -sticks.z * most if holds.depth is None else 0.0
    yaw_rate = sticks.r * parameters["HIL_YAW_RATE"] if holds.heading is None else 0.0
    depth = None if holds.depth is None else min(holds.depth, parameters["HIL_DEPTH_MAX"])
    return VelocityCommand(surge, sway, heave, yaw_rate, depth, holds.heading)


def go_to(
    target: Point, heading: float | None, state: State, parameters: ParameterTable, speed: float | None = None
) -> VelocityCommand:
    """Return the command that leads straight to a place at most at `speed` m/s, bow first unless a heading is given."""
    speed = parameters["WPNAV_SPEED"] if speed is None else speed
    depth = min(max(0.0, target[2]), parameters["HIL_DEPTH_MAX"])
    north, east = target[0] - state.position[0], target[1] - state.position[1]
    bearing, distance = atan2(east, north), hypot(north, east)
    if parameters["HIL_STEER"]:  # turns by fins: it sails through the place, and round it
        ahead = speed if distance > parameters["WPNAV_RADIUS"] else 0.5 * speed
        return VelocityCommand(surge=ahead, depth=depth, heading=bearing)
    if heading is None:
        bow_first = parameters["WP_YAW_BEHAVIOR"] and distance > FAR
        heading = bearing if bow_first else state.heading
    command = approach((target[0], target[1], depth), heading, state.position, state.heading, _gains(parameters, speed))
    off = abs(wrap(heading - state.heading))
    if distance > FAR and off > 0.5 and parameters["WP_YAW_BEHAVIOR"]:
        return command._replace(surge=0.3 * command.surge, sway=0.3 * command.sway)  # turn first
    return command


def is_reached(target: Point, state: State, radius: float) -> bool:
    """Return whether the vehicle is within `radius` m of a place."""
    return dist(target, state.position) <= radius


def level_velocity(state: State) -> tuple[float, float]:
    """Return the velocity to north and east (m/s) of a vehicle that is nearly level."""
    surge, sway, _ = state.velocity
    heading = state.heading
    return surge * cos(heading) - sway * sin(heading), surge * sin(heading) + sway * cos(heading)


def in_body(north: float, east: float, heading: float) -> tuple[float, float]:
    """Return what is ahead and to starboard of a level vector to north and east."""
    return north * cos(heading) + east * sin(heading), east * cos(heading) - north * sin(heading)


def in_world(ahead: float, right: float, heading: float) -> tuple[float, float]:
    """Return what is to north and east of a level vector ahead and to starboard."""
    return ahead * cos(heading) - right * sin(heading), ahead * sin(heading) + right * cos(heading)


def _down(state: State) -> float:
    """Return the velocity down (m/s) of a vehicle that is nearly level."""
    return state.velocity[2] - state.pitch * state.velocity[0]


def _gains(parameters: ParameterTable, speed: float) -> HoldGains:
    return HoldGains(p=parameters["PSC_POSXY_P"], limit=max(speed, 1e-3))
