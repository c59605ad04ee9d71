"""Path following on a simple vehicle: surge and turn rate follow the command with a lag."""

import math
import random
from collections.abc import Callable
from itertools import pairwise

import pytest

from hil.autonomy.control.controller import VelocityCommand
from hil.autonomy.paths.pursuit import PurePursuit
from hil.common.errors import MissionError

DT = 0.05
Point = tuple[float, float]


class Track:
    """A run with one entry a step."""

    def __init__(self) -> None:
        self.points: list[Point] = []
        self.surges: list[float] = []
        self.turns: list[float] = []
        self.offsets: list[float] = []
        self.progress: list[float] = []


def follow(
    pursuit: PurePursuit,
    start: Point,
    heading: float,
    seconds: float = 300.0,
    noise: Callable[[], float] = lambda: 0.0,
    lag: float = 0.4,
) -> Track:
    """Let a vehicle follow until done or out of time. `noise` is added to each measured coordinate, m."""
    (north, east), surge, yaw_rate, track = start, 0.0, 0.0, Track()
    for _ in range(int(seconds / DT)):
        measured = north + noise(), east + noise()
        command = pursuit.update((*measured, 3.0), heading)
        surge += (command.surge - surge) * DT / lag
        yaw_rate += (command.yaw_rate - yaw_rate) * DT / lag
        heading += yaw_rate * DT
        north += surge * math.cos(heading) * DT
        east += surge * math.sin(heading) * DT
        track.points.append((north, east))
        track.surges.append(command.surge)
        track.turns.append(command.yaw_rate)
        track.progress.append(pursuit.progress)
        if pursuit.has_arrived:
            break
        track.offsets.append(math.dist(measured, pursuit._path.at(pursuit._along)))
    return track


def test_a_straight_path_is_followed_to_its_end() -> None:
    pursuit = PurePursuit([(0.0, 0.0), (30.0, 0.0)], lookahead=2.0, speed=0.8, tolerance=0.3)
    track = follow(pursuit, (0.0, 0.0), 0.0)
    assert pursuit.has_arrived
    assert math.dist(track.points[-1], (30.0, 0.0)) <= 0.3
    assert max(track.offsets) < 1e-9
    assert max(track.surges) == pytest.approx(0.8)
    assert 30.0 / 0.8 < len(track.points) * DT < 30.0 / 0.8 + 10.0
    assert math.dist(track.points[-1], track.points[-2]) < 0.5 * 0.8 * DT  # it came slowly


def test_the_command_has_the_value_worked_out_by_hand() -> None:
    """A vehicle 1 m to port of a path to the north with lookahead 2 m aims 2 m north and 1 m east. Coulter's curvature
    is 2 sin(error) / lookahead for small errors: at 0.5 m/s a gain of 0.5 rad/s for each rad.
    """
    pursuit = PurePursuit([(0.0, 0.0), (30.0, 0.0)], lookahead=2.0, speed=0.5)
    command = pursuit.update((1.0, -1.0), 0.0)
    assert pursuit.aim == pytest.approx(math.atan2(1.0, 2.0))
    assert command.yaw_rate == pytest.approx(0.5 * 0.46364761)
    assert command.surge == pytest.approx(0.5 * 2.0 / math.sqrt(5.0))


def test_the_command_stays_stop_once_done_even_if_the_vehicle_drifts() -> None:
    pursuit = PurePursuit([(0.0, 0.0, 4.0), (1.0, 0.0, 4.0)], lookahead=1.0, speed=0.5)
    assert pursuit.update((0.0, 0.0), 0.0).depth == 4.0
    assert pursuit.update((0.9, 0.1), 0.0) == VelocityCommand(depth=4.0)
    assert pursuit.has_arrived
    assert pursuit.progress == 1.0
    assert pursuit.update((-9.0, 5.0), 2.0) == VelocityCommand(depth=4.0)


@pytest.mark.parametrize("offset", [-6.0, -0.7, 0.7, 6.0])
@pytest.mark.parametrize("heading", [0.0, math.pi / 2.0, math.pi, -2.0])
def test_a_vehicle_beside_the_path_converges_without_oscillation(offset: float, heading: float) -> None:
    pursuit = PurePursuit([(0.0, 0.0), (60.0, 0.0)], lookahead=2.5, speed=0.7)
    track = follow(pursuit, (0.0, offset), heading)
    assert pursuit.has_arrived
    side = math.copysign(1.0, offset)
    easts = [east for _, east in track.points]
    assert min(east * side for east in easts) > -0.35  # hardly beyond the path
    settled = easts[len(easts) // 2 :]
    assert max(map(abs, settled)) < 0.02
    swings = sum(a * b < 0.0 for a, b in pairwise(settled) if abs(a) > 1e-3)
    assert swings == 0


def test_a_right_angle_is_cut_by_at_most_a_third_of_the_lookahead() -> None:
    path = [(0.0, 0.0), (20.0, 0.0), (20.0, 20.0)]
    pursuit = PurePursuit(path, lookahead=2.0, speed=0.6)
    track = follow(pursuit, (0.0, 0.0), 0.0)
    assert pursuit.has_arrived
    assert max(track.offsets) < 2.0 / 3.0
    assert max(north for north, _ in track.points) < 20.3  # no swing wide of the bend
    assert track.progress == sorted(track.progress)


def test_closed_and_crossing_paths_are_followed_completely() -> None:
    eight = [(0.0, 0.0), (10.0, 10.0), (10.0, 0.0), (0.0, 10.0), (0.0, 0.0)]
    pursuit = PurePursuit(eight, lookahead=1.5, speed=0.5, tolerance=0.4)
    assert pursuit.update((0.0, 0.0), 0.8).surge > 0.0
    assert not pursuit.has_arrived
    track = follow(pursuit, (0.0, 0.0), 0.8)
    assert pursuit.has_arrived
    assert sum(map(math.dist, track.points, track.points[1:])) > 40.0


def test_the_vehicle_turns_towards_the_path_before_it_advances() -> None:
    pursuit = PurePursuit([(0.0, 0.0), (10.0, 0.0)], lookahead=1.0, speed=0.6, max_yaw_rate=0.3)
    behind = pursuit.update((0.0, 0.0), math.pi - 0.1)
    assert behind.surge == 0.0
    assert behind.yaw_rate == -0.3
    track = follow(pursuit, (0.0, 0.0), math.pi - 0.1)
    assert pursuit.has_arrived
    assert max(map(abs, track.turns)) <= 0.3
    assert min(track.surges) >= 0.0
    assert min(north for north, _ in track.points) > -0.2


@pytest.mark.parametrize("seed", range(5))
def test_any_path_is_finished_with_a_noisy_position(seed: int) -> None:
    generator = random.Random(seed)
    path = [(generator.uniform(0.0, 30.0), generator.uniform(0.0, 30.0)) for _ in range(6)]
    pursuit = PurePursuit(path, lookahead=2.0, speed=0.7, tolerance=0.5)
    follow(pursuit, (0.0, 0.0), generator.uniform(-3.0, 3.0), 600.0, lambda: generator.gauss(0.0, 0.05))
    assert pursuit.has_arrived


def test_paths_of_one_point_or_repeated_points_are_followed() -> None:
    pursuit = PurePursuit([(5.0, 5.0)], lookahead=1.0, speed=0.5)
    track = follow(pursuit, (0.0, 0.0), 0.0)
    assert pursuit.has_arrived
    assert math.dist(track.points[-1], (5.0, 5.0)) <= 0.5
    pursuit = PurePursuit([(0.0, 0.0), (0.0, 0.0), (4.0, 0.0), (4.0, 0.0)], lookahead=1.0, speed=0.5)
    follow(pursuit, (0.0, 0.0), 0.0)
    assert pursuit.has_arrived


def test_empty_paths_and_zero_speed_are_refused() -> None:
    with pytest.raises(MissionError, match="empty"):
        PurePursuit([], lookahead=1.0, speed=0.5)
    with pytest.raises(MissionError, match="above 0"):
        PurePursuit([(0.0, 0.0), (1.0, 0.0)], lookahead=1.0, speed=0.0)


def test_the_depth_of_a_path_is_followed_on_slopes_and_at_vertical_parts() -> None:
    """A point that dives with 0.4 m/s at most: a gentle slope at full speed, one of 60 degrees slower, and straight up.

    It passes each place within the tolerance, and ends at the depth of the last one.
    """
    places = [(0.0, 0.0, 5.0), (10.0, 0.0, 7.0), (16.0, 0.0, 17.4), (16.0, 0.0, 4.0), (16.0, 6.0, 4.0)]
    pursuit = PurePursuit(places, lookahead=1.5, speed=0.5, tolerance=0.5)
    north, east, depth, heading = 0.0, 0.0, 5.0, 0.0
    track: list[tuple[float, float, float, float]] = []
    while not pursuit.has_arrived and len(track) < 4000:
        command = pursuit.update((north, east, depth), heading)
        assert command.depth is not None
        heave = max(-0.4, min(0.4, 0.8 * (command.depth - depth)))
        heading += 0.05 * command.yaw_rate
        north += 0.05 * command.surge * math.cos(heading)
        east += 0.05 * command.surge * math.sin(heading)
        depth += 0.05 * heave
        track.append((north, east, depth, command.surge))
    assert pursuit.has_arrived
    assert all(min(math.dist(place, here[:3]) for here in track) < 0.72 for place in places)
    gentle = [here for here in track if 2.0 < here[0] < 8.5 and here[2] < 7.0]
    assert all(surge > 0.48 and abs(deep - 5.0 - 0.2 * at) < 0.1 for at, _, deep, surge in gentle)
    steep = [here for here in track if 11.0 < here[0] < 14.0]
    assert all(0.2 < surge < 0.26 for *_, surge in steep), "0.4 m/s over tan 60 degrees"
    assert all(abs(deep - 7.0 - (at - 10.0) * 10.4 / 6.0) < 0.5 for at, _, deep, _ in steep)
