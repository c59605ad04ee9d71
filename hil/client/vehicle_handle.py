"""One vehicle in the Python interface: its samples and its commands."""

import threading
import time
from collections.abc import Sequence
from math import atan2, hypot, isfinite
from typing import Any

from hil.autonomy.control.controller import VelocityCommand
from hil.autonomy.paths.curves import Curve, Position, polyline
from hil.autonomy.paths.dubins import Pose
from hil.autonomy.paths.spline import Spline
from hil.autonomy.paths.trajectory import Limits, Trajectory
from hil.client import action as actions
from hil.client import samples
from hil.client.action import Action
from hil.client.vehicle_state import VehicleState
from hil.common.errors import ConfigError, MissionError, NetworkError
from hil.ros.commands import (
    MAX_DEPTH,
    MAX_FORCE,
    MAX_HEADING,
    MAX_PLACE,
    PoseCommand,
    encode_thrusts,
)
from hil.ros.frames import encode_wrench

PERIOD_S = 0.05  # of repeated commands; the vehicle's deadman timeout is ten of these
GIVE_UP_AFTER_S = 10.0  # without a message from the vehicle
MAX_SPEED = 20.0  # m/s and rad/s
FAR = 1.0  # m; at larger distances a vehicle turns its bow toward its goal


class Vehicle(VehicleState):
    """One vehicle. Its samples are attributes; its commands are methods.

    Commands return at once. Only the first may wait, if another master was active, until the vehicle reports whether
    that one stays. The vehicle executes a command until it gets another one. This process repeats the command
    meanwhile; when the process ends, the vehicle stops. Units are SI and radians. Positions are NED in m, with depth
    down; vectors along the body are FRD.

    Every attribute raises NetworkError if the vehicle is lost or has no such sensor. Every command also raises it if
    the vehicle refuses, and ConfigError for values out of range.
    """

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._action: Action | None = None
        self._lock = threading.RLock()  # held while a command is sent or replaced
        self._repeater = threading.Thread(target=self._repeat, name=f"commands {self.name}", daemon=True)

    def drive(
        self,
        surge: float = 0.0,
        sway: float = 0.0,
        heave: float = 0.0,
        yaw_rate: float = 0.0,
        depth: float | None = None,
        heading: float | None = None,
        tolerance: float = 0.1,
    ) -> Action:
        """Drive with these velocities (m/s, rad/s). A depth (m) replaces heave, a heading (rad) replaces yaw rate.

        Done when depth and heading are within `tolerance` m and rad; at once without them.
        """
        if (depth is not None and heave) or (heading is not None and yaw_rate):
            raise ConfigError(f"{self.name}: give depth or heave, and heading or yaw_rate, not both")
        speeds = {"surge": surge, "sway": sway, "heave": heave, "yaw_rate": yaw_rate}
        for name, value in speeds.items():
            self._check(name, value, MAX_SPEED, "rad/s" if name == "yaw_rate" else "m/s")
        self._check("depth", depth or 0.0, MAX_DEPTH, "m")
        self._check("heading", heading or 0.0, MAX_HEADING, "rad")
        return self._start_action(actions.drive(VelocityCommand(**speeds, depth=depth, heading=heading), tolerance))

    def stop(self) -> Action:
        """Stop relative to the water; depth and heading are not held."""
        return self.drive()

    def hold_depth(self, depth: float, tolerance: float = 0.1) -> Action:
        """Dive or rise to a depth (m) and stay there; done within `tolerance` m."""
        return self.drive(depth=depth, tolerance=tolerance)

    def hold_heading(self, heading: float, tolerance: float = 0.1) -> Action:
        """Turn to a heading (rad from north, clockwise) and hold it; done within `tolerance` rad."""
        return self.drive(heading=heading, tolerance=tolerance)

    def go_to(
        self, north: float, east: float, depth: float, heading: float | None = None, tolerance: float = 0.3
    ) -> Action:
        """Go straight to a position (m, NED) and stay there; done within `tolerance` m and rad.

        Without a `heading` (rad) it goes bow first. Obstacles are not avoided; to do so, plan a path and `follow` it.
        For vehicles that can stop and move sideways.
        """
        for name, value in (("north", north), ("east", east), ("depth", depth)):
            self._check(name, value, MAX_PLACE, "m")
        if heading is None:
            state = self.state
            level = north - state.position[0], east - state.position[1]
            heading = atan2(level[1], level[0]) if hypot(*level) > FAR else state.heading
        self._check("heading", heading, MAX_HEADING, "rad")
        return self._start_action(actions.hold_pose(PoseCommand((north, east, depth), heading), tolerance))

    def follow(
        self,
        path: "Sequence[Position] | Curve | Trajectory",
        speed: float = 0.5,
        limits: Limits = Limits(),
        smooth: bool = False,
        lookahead: float = 0.0,
        tolerance: float = 0.3,
    ) -> Action:
        """Follow a path and stay at its end; done within `tolerance` m and rad of it.

        `path` is one of: points (m, NED), followed from the present position on, with rounded corners if `smooth`; a
        curve (hil.autonomy.paths: curves, spline, dubins); or a trajectory, which has its own speed. Otherwise the
        speed is at most `speed` m/s, within `limits`. With a `lookahead` (m) points are followed by pure pursuit; if
        `limits` have a turning radius, as for a vehicle with fins, by line of sight along Dubins legs within their
        climb angle. Raises ConfigError, MissionError if the path breaks a limit.
        """
        if isinstance(path, Trajectory):
            return self._start_action(actions.run_trajectory(path, limits, tolerance))
        if isinstance(path, Sequence):
            points = self._points(path)
            if lookahead and limits.turn_radius:
                start = Pose(self.state.position, self.state.heading)
                return self._start_action(actions.follow_legs(points[1:], start, speed, limits, lookahead, tolerance))
            if lookahead:
                return self._start_action(actions.pursue(points, speed, lookahead, tolerance))
            curve: Curve = Spline(points) if smooth else polyline(points)
        else:
            curve = path
        return self._start_action(actions.run_trajectory(Trajectory(curve, speed, limits), limits, tolerance))

    def push(
        self, x: float = 0.0, y: float = 0.0, z: float = 0.0, k: float = 0.0, m: float = 0.0, n: float = 0.0
    ) -> Action:
        """Apply a force X Y Z (N) and a moment K M N (N m) along FRD, limited to what the thrusters can give."""
        wrench = x, y, z, k, m, n
        for name, value in zip("xyzkmn", wrench, strict=True):
            self._check(name, value, MAX_FORCE, "N" if name in "xyz" else "N m")
        return self._start_action(actions.repeat("cmd_wrench", encode_wrench(0, wrench)))

    def thrust(self, *newtons: float) -> Action:
        """Set the thrust (N) of each thruster, in the order of the vehicle file, limited to what it can give."""
        count = self.diagnostics.thrusters
        if count is not None and len(newtons) != count:
            raise ConfigError(
                f"{self.name} has {count} thrusters, and {len(newtons)} thrusts were given; give one for each"
            )
        for number, value in enumerate(newtons, 1):
            self._check(f"thruster {number}", value, MAX_FORCE, "N")
        return self._start_action(actions.repeat("cmd_thrusters", encode_thrusts(newtons)))

    def release(self) -> None:
        """Send no more commands: the vehicle's deadman then sets the thrusters to neutral."""
        with self._lock:
            self._replace(None)

    def close(self) -> None:
        """Stop the vehicle if it was commanded, and disconnect. May be called twice."""
        if self._closing.is_set():
            return
        self._closing.set()
        self.release()
        if self._repeater.is_alive():
            self._repeater.join()
        super().close()

    def _check(self, name: str, value: float, most: float, unit: str) -> None:
        if not (isfinite(value) and abs(value) <= most):
            raise ConfigError(f"{self.name}: {name}: {value:g} is not between -{most:g} and {most:g} {unit}")

    def _points(self, points: Sequence[Any]) -> list[Position]:
        for point in points:
            if len(point) != 3:
                raise ConfigError(f"{self.name}: a waypoint is (north, east, depth) in m, found {point!r}")
            for value in point:
                self._check("waypoint", value, MAX_PLACE, "m")
        return [self.state.position, *[(north, east, depth) for north, east, depth in points]]

    def _start_action(self, new: Action) -> Action:
        """Start an action at once. Raises NetworkError if the vehicle would refuse it."""
        if self._role == "observer":
            raise NetworkError(f"{self.name} is only observed here; connect without observe=True to command it")
        self._require_presence()
        self.client.require_acceptance(pause=self._pause)
        with self._lock:
            self._replace(new)
            self._step()
            if not self._repeater.is_alive():
                self._repeater.start()
        return new

    def _pause(self, seconds: float) -> None:
        self._require_presence()
        time.sleep(seconds)

    def _replace(self, new: Action | None) -> None:
        if self._action:
            self._action.end()
        self._action = new

    def _repeat(self) -> None:
        while not self._closing.wait(PERIOD_S):
            with self._lock:
                self._step()

    def _step(self) -> None:
        """Send the current command once more, while the vehicle is present and accepts it."""
        action, stamped = self._action, self.client.latest.get("odom")
        if action is None or stamped is None:
            return
        try:
            if self.present:
                reason = self.client.unavailable_reason()
                if reason:
                    raise NetworkError(reason)
                action.step(self.client, samples.aged("odom", stamped))
            elif self.client.contact.silence_s > GIVE_UP_AFTER_S:
                self._require_presence()
        except (NetworkError, MissionError) as error:
            action.end(error)
            self._action = None
