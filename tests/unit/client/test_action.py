"""Actions, from their messages to where the vehicle then is, without network and clock."""

import asyncio
from collections.abc import Iterator
from math import dist, pi

import pytest

from hil.autonomy.control.controller import VelocityCommand, wrap
from hil.autonomy.paths.curves import Position, circle, polyline
from hil.autonomy.paths.dubins import Pose
from hil.autonomy.paths.spline import Spline
from hil.autonomy.paths.trajectory import Limits, Trajectory
from hil.client import action as actions
from hil.client.action import Action
from hil.client.client import VehicleClient
from hil.client.samples import State
from hil.common.errors import MissionError, NetworkError
from hil.ros.commands import PoseCommand, encode_thrusts
from tests.support.flights.flying import Bench

LIMITS = Limits(acceleration=0.3)


class DirectClient(VehicleClient):
    """A client whose messages go straight to a vehicle."""

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        self.topics: set[str] = set()

    def send(self, topic: str, payload: bytes) -> int:
        self.topics.add(topic)
        self.bench.send(topic, payload)
        return 0


@pytest.fixture
def client() -> Iterator[DirectClient]:
    bench = Bench()
    yield DirectClient(bench)
    bench.command_receiver.close()


def fly_until_done(client: DirectClient, reported: Action, seconds: float) -> list[State]:
    """Advance until the action is done; return where the vehicle was on the way."""
    track: list[State] = []

    def say(state: State) -> bool:
        track.append(state)
        reported.step(client, state)
        return reported.done

    client.bench.lead(seconds, say)
    return track


def farthest(track: list[State], path: list[Position]) -> float:
    """Return the largest distance (m) of the vehicle from the nearest of some points of the path."""
    return max(min(dist(state.position, point) for point in path) for state in track)


def test_depth_and_heading_actions_end_when_both_are_reached(client: DirectClient) -> None:
    reported = actions.drive(VelocityCommand(depth=3.0, heading=2.0), 0.1)
    track = fly_until_done(client, reported, 20.0)
    assert reported.done
    assert abs(track[-1].depth - 3.0) <= 0.1
    assert abs(wrap(track[-1].heading - 2.0)) <= 0.1
    assert not any(abs(s.depth - 3.0) <= 0.1 and abs(wrap(s.heading - 2.0)) <= 0.1 for s in track[:-1])
    assert client.topics == {"cmd_vel", "cmd_depth", "cmd_heading"}


def test_a_pose_action_ends_within_its_tolerance(client: DirectClient) -> None:
    reported = actions.hold_pose(PoseCommand((6.0, 6.0, 2.5), pi / 2), 0.2)
    track = fly_until_done(client, reported, 30.0)
    assert reported.done
    assert dist(track[-1].position, (6.0, 6.0, 2.5)) <= 0.2
    assert dist(track[-2].position, (6.0, 6.0, 2.5)) > 0.2 or abs(track[-2].heading - pi / 2) > 0.2


@pytest.mark.parametrize("smooth", [False, True])
def test_a_trajectory_is_followed_within_0_35_m(client: DirectClient, smooth: bool) -> None:
    points = [(4.0, 4.0, 2.0), (7.0, 4.0, 2.5), (7.0, 7.0, 3.0), (5.0, 7.0, 2.5)]
    curve = Spline(points) if smooth else polyline(points)
    reported = actions.run_trajectory(Trajectory(curve, 0.4, LIMITS), LIMITS, 0.3)
    track = fly_until_done(client, reported, 80.0)
    assert reported.done
    assert dist(track[-1].position, points[-1]) <= 0.3
    way = [curve.at(curve.length * share / 400).position for share in range(401)]
    assert farthest(track, way) < 0.35
    assert all(min(dist(state.position, point) for state in track) < 0.35 for point in points)


def test_a_trajectory_action_lasts_as_long_as_its_trajectory(client: DirectClient) -> None:
    trajectory = Trajectory(circle((6.0, 4.0, 2.0), 2.0, turns=0.5, bearing=pi), 0.4, LIMITS)
    reported = actions.run_trajectory(trajectory, LIMITS, 0.3)
    track = fly_until_done(client, reported, 80.0)
    took = (track[-1].time_ns - track[0].time_ns) / 1e9
    assert took == pytest.approx(trajectory.duration, abs=2.5)
    assert client.topics == {"cmd_vel", "cmd_pose"}, "the vehicle stays at the end"


def test_a_pursuit_turns_and_moves_ahead(client: DirectClient) -> None:
    points = [(4.0, 4.0, 2.0), (7.0, 5.0, 3.0), (8.0, 8.0, 3.0)]
    reported = actions.pursue(points, 0.4, 0.8, 0.4)
    track = fly_until_done(client, reported, 60.0)
    assert reported.done
    assert dist(track[-1].position, points[-1]) < 0.6
    half = min(track, key=lambda state: abs(state.position[0] - 5.5))
    assert half.depth == pytest.approx(2.5, abs=0.3), "it dives evenly along the path"
    assert max(abs(state.velocity[1]) for state in track) < 0.15, "never sideways"


def test_legs_are_followed_through_every_point_without_a_stop(client: DirectClient) -> None:
    points = [(7.0, 5.0, 3.0), (8.0, 8.0, 2.0), (5.0, 9.0, 2.0)]
    limits = Limits(turn_radius=1.2, climb_angle=0.4)
    reported = actions.follow_legs(points, Pose((4.0, 4.0, 2.0), 0.0), 0.4, limits, 1.2, 0.4)
    track = fly_until_done(client, reported, 90.0)
    assert reported.done
    assert all(min(dist(state.position, point) for state in track) < 0.5 for point in points)
    assert min(state.velocity[0] ** 2 + state.velocity[1] ** 2 for state in track[100:-1]) > 0.3**2


def endless_action() -> Action:
    return actions.drive(VelocityCommand(depth=500.0), 0.1)


def test_wait_raises_why_the_action_ended() -> None:
    reported = endless_action()
    with pytest.raises(MissionError, match=r"within 0\.01 s; give it more time"):
        reported.wait(0.01)
    reported.end()
    with pytest.raises(MissionError, match="another command"):
        reported.wait()
    reported = endless_action()
    reported.end(NetworkError("gone"))
    reported.end(NetworkError("gone again"))
    with pytest.raises(NetworkError, match=r"gone$"):
        reported.wait()


def test_a_done_action_can_still_fail(client: DirectClient) -> None:
    """No master holds the vehicle by this action once another master has taken over."""
    reported = actions.repeat("cmd_thrusters", encode_thrusts((1.0,) * 6))
    reported.step(client, client.bench.state)
    assert reported.wait(0.0).done
    reported.end()
    assert reported.error is None
    reported.end(NetworkError("taken over"))
    with pytest.raises(NetworkError, match="taken over"):
        reported.wait()


def test_an_action_can_be_awaited(client: DirectClient) -> None:
    async def run_both() -> Action:
        reported = actions.repeat("cmd_thrusters", encode_thrusts((1.0,) * 6))
        asyncio.get_running_loop().call_later(0.05, reported.step, client, client.bench.state)
        return await reported

    assert asyncio.run(run_both()).done

    async def fail() -> None:
        reported = endless_action()
        reported.end(NetworkError("gone"))
        await reported

    with pytest.raises(NetworkError, match="gone"):
        asyncio.run(fail())
