"""An action of a vehicle: a command that is repeated until it is done or replaced.

An action is a small state machine without a clock or a thread of its own. The vehicle itself holds poses; paths are
followed here, by velocity commands.
"""

import threading
from collections.abc import Callable, Generator
from math import atan2, dist
from typing import TYPE_CHECKING, Any

from hil.autonomy.control.controller import VelocityCommand, wrap
from hil.autonomy.paths.dubins import Pose
from hil.autonomy.paths.line_of_sight import LineOfSight, dubins_legs
from hil.autonomy.paths.pursuit import PurePursuit
from hil.autonomy.paths.trajectory import Limits, Trajectory, track_setpoint
from hil.client.client import VehicleClient
from hil.client.samples import State
from hil.common.clock import NS_PER_S
from hil.common.errors import HilError, MissionError
from hil.ros.commands import PoseCommand, encode_pose

if TYPE_CHECKING:
    from hil.autonomy.paths.curves import Chain, Position

POLL_S = 0.05  # polling period of a coroutine that awaits an action
TRACKING_GAIN = 0.5  # 1/s, of the position error along a path

Send = Callable[[VehicleClient, State], None]
Reached = Callable[[State], bool]


class Action:
    """An action of the vehicle. `done` becomes true when it reaches its goal, which the vehicle then holds.

    It ends without being done when another command replaces it, or with an error when the vehicle refuses it or stays
    lost; `wait` raises that error. An action that is done may also get an error: then the vehicle no longer holds the
    goal.
    """

    def __init__(self, send: Send, reached: Reached) -> None:
        self._send = send
        self._reached = reached
        self._over = threading.Event()
        self.error: HilError | None = None
        self.done = False

    @property
    def over(self) -> bool:
        """True once the action is done or has ended; `error` has the reason for a failure, if known."""
        return self._over.is_set()

    def step(self, client: VehicleClient, state: State) -> None:
        """Send the command again; `state` is the vehicle's. Raises HilError if the action cannot continue."""
        if not self.done and self._reached(state):
            self.done = True
            self._over.set()
        self._send(client, state)

    def end(self, error: HilError | None = None) -> None:
        """End the action, with or without an error."""
        self.error = self.error or error
        self._over.set()

    def wait(self, timeout: float | None = None) -> "Action":
        """Wait until it is done, at most `timeout` s. Raises its error; MissionError if it is replaced or times out."""
        if not self._over.wait(timeout):
            raise MissionError(
                f"the vehicle has not reached what was requested within {timeout:g} s; give it more time"
            )
        if self.error:
            raise self.error
        if not self.done:
            raise MissionError("another command reached the vehicle before this action was done")
        return self

    def __await__(self) -> Generator[Any, None, "Action"]:
        """Await the end without blocking asyncio: `await action`. Raises the errors of `wait`."""
        return self._finish().__await__()

    async def _finish(self) -> "Action":
        import asyncio  # already imported by a program that awaits

        while not self._over.is_set():
            await asyncio.sleep(POLL_S)
        return self.wait()


def drive(command: VelocityCommand, tolerance: float) -> Action:
    """Drive with a velocity command; done within `tolerance` m and rad of its depth and heading, if set."""

    def reached(state: State) -> bool:
        deep = command.depth is None or abs(state.depth - command.depth) <= tolerance
        turned = command.heading is None or abs(wrap(state.heading - command.heading)) <= tolerance
        return deep and turned

    return Action(lambda client, _: _ignore(client.command(command)), reached)


def repeat(topic: str, payload: bytes) -> Action:
    """Send the same command repeatedly; done at once."""
    return Action(lambda client, _: _ignore(client.send(topic, payload)), lambda _: True)


def hold_pose(pose: PoseCommand, tolerance: float) -> Action:
    """Go to a pose and hold it; done within `tolerance` m and rad of it."""

    def reached(state: State) -> bool:
        turned = abs(wrap(state.heading - pose.heading)) <= tolerance
        return turned and dist(state.position, pose.position) <= tolerance

    return Action(lambda client, state: _ignore(client.send("cmd_pose", encode_pose(pose, state.time_ns))), reached)


class _Run:
    """A trajectory in progress, timed by the vehicle's clock; the vehicle holds the pose at its end."""

    def __init__(self, trajectory: Trajectory, limits: Limits, tolerance: float) -> None:
        self._trajectory = trajectory
        self._limits = limits
        self._tolerance = tolerance
        self._began_ns = 0
        end = trajectory.at(trajectory.duration)
        self._end = hold_pose(PoseCommand(end.position, end.heading), tolerance)

    def send(self, client: VehicleClient, state: State) -> None:
        elapsed = self._elapsed(state)
        if elapsed > self._trajectory.duration:
            self._end.step(client, state)
            return
        setpoint = self._trajectory.at(elapsed)
        client.command(track_setpoint(setpoint, state.position, state.heading, self._limits, TRACKING_GAIN))

    def reached(self, state: State) -> bool:
        return self._elapsed(state) > self._trajectory.duration and self._end.done

    def _elapsed(self, state: State) -> float:
        self._began_ns = self._began_ns or state.time_ns
        return (state.time_ns - self._began_ns) / NS_PER_S


def run_trajectory(trajectory: Trajectory, limits: Limits, tolerance: float) -> Action:
    """Follow a trajectory in time, within `limits`; done within `tolerance` m and rad of its end."""
    run = _Run(trajectory, limits, tolerance)
    return Action(run.send, run.reached)


def follow_legs(
    points: "list[Position]", start: Pose, speed: float, limits: Limits, lookahead: float, tolerance: float
) -> Action:
    """Follow Dubins legs from `start` through `points` (m, NED) with line of sight, for a vehicle that cannot stop.

    Done when it passes the last point within `tolerance` m; until then it approaches that point again.
    """
    left = [points]

    def approach(pose: Pose) -> "Chain":
        return dubins_legs([pose.position, *(left.pop() if left else points[-1:])], pose.heading, limits)

    sight = LineOfSight(approach, start, speed, limits, lookahead, tolerance)

    def send(client: VehicleClient, state: State) -> None:
        u, v, _ = state.velocity
        client.command(sight.update(state.position, state.heading, state.heading + atan2(v, u)))

    return Action(send, lambda _: sight.has_arrived)


def pursue(points: "list[Position]", speed: float, lookahead: float, tolerance: float) -> Action:
    """Follow `points` (m, NED) by steering toward a point ahead.

    The depth changes linearly along each leg. Done within `tolerance` m of the last point.
    """
    pursuit = PurePursuit(points, lookahead, speed, tolerance=tolerance)

    def send(client: VehicleClient, state: State) -> None:
        client.command(pursuit.update(state.position, state.heading))

    return Action(send, lambda _: pursuit.has_arrived)


def _ignore(_sequence: int) -> None:
    """Discard the sequence number of a command, to return None."""
