"""Planners alone: within limits for any input, and equal over the network and without it."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from hil.autonomy.control.controller import VelocityCommand
from hil.autonomy.paths.curves import Position
from hil.autonomy.paths.occupancy import OccupancyGrid
from hil.cases.simulated import SimulatedVehicle
from hil.common.errors import MissionError
from hil.master.avoid import Avoid
from hil.master.flight import HEADING_HOLD, Flight, distance_to_path, held, prepare
from hil.master.follow import Follow
from hil.master.planner import Done, Planner, PlanRequest, Samples
from hil.master.tasks import Tasks, hold_position
from hil.ros import encoders as ros
from hil.scenario.config import load_scenario
from hil.scenario.records import Master, Start
from hil.scenario.world_map import known_map
from sim.environment.obstacles import STANDING, Cylinder
from sim.environment.world import World
from sim.rotations import from_euler
from sim.sensors.extra_samples import BatterySample, LaserSample
from sim.sensors.samples import OdometrySample
from sim.vehicle.vehicle import load_vehicle
from tests.support.examples import examples

SIX, _ = load_vehicle("paper_six")
NS = 1_000_000_000
SPEED, TURN, CELL, MARGIN = 0.7, 0.4, 0.25, 0.4
TASKS = [
    {"name": "look", "at": [4.0, 16.0], "duration": 2.0},
    {"name": "charge", "at": [4.0, 2.0], "duration": 1.0, "when": "battery < 0.3", "urgent": True, "priority": 5,
     "repeat": True},
]  # fmt: skip

numbers = st.floats(-1e3, 1e3)
ranges = st.one_of(st.floats(0.0, 30.0), st.sampled_from([math.inf, -math.inf, math.nan, -1.0]))
points = st.tuples(st.floats(-5.0, 25.0), st.floats(-5.0, 25.0), st.floats(0.0, 10.0))
piles = st.lists(
    st.builds(
        Cylinder,
        st.floats(4.0, 16.0),
        st.floats(4.0, 16.0),
        st.floats(0.2, 2.0),
        st.just(-100.0),
        st.just(False),
        bottom=st.just(STANDING),
    ),
    max_size=7,
)


def request(world: World, text: str = "known") -> PlanRequest:
    master = Master(goal=(19.0, 18.0), depth=5.0, speed=SPEED, margin=MARGIN, map=text)
    radius = math.hypot(*SIX.dimensions[:2]) / 2
    course = [(1.0, 1.0, 5.0), *master.places()]

    def map_along(course: Sequence[Position]) -> OccupancyGrid:
        return known_map(master, SIX, world, None, course)

    return PlanRequest("uuv1", SIX, Start(1.0, 1.0), master, map_along(course), radius + MARGIN, course, map_along)


def pool(cylinders: list[Cylinder]) -> World:
    return World("some", "made up", (0.0, 20.0, 0.0, 20.0), 10.0, cylinder=tuple(cylinders))


def odometry(position: tuple[float, float, float], heading: float, time_ns: int) -> OdometrySample:
    return OdometrySample(time_ns, position, from_euler(0.0, 0.0, heading), (0.1, 0.0, 0.0, 0.0, 0.0, 0.0))


def planners() -> list[Planner]:
    return [
        Follow(),
        Avoid(max_yaw_rate=TURN),
        Avoid(max_yaw_rate=TURN, search="any_angle"),
        Tasks(home=[1.0, 1.0], task=TASKS, max_yaw_rate=TURN),
    ]


@examples(15)
@given(piles, st.lists(st.tuples(points, st.floats(-4.0, 4.0), st.lists(ranges, min_size=2, max_size=40)), max_size=6))
def test_commands_stay_within_limits_for_any_input(cylinders: list[Cylinder], reported: list[Any]) -> None:
    """Any position, heading and scan comes, in any order, with non-finite echoes among them."""
    for planner in planners():
        try:
            planner.begin(request(pool(cylinders)))
        except MissionError:
            continue  # the piles block every path, which is reported before the dive
        for number, (place, heading, echoes) in enumerate(reported):
            scan = LaserSample(number * NS // 10, -1.5, 3.0 / (len(echoes) - 1), tuple(echoes), (0.1, 30.0))
            samples = {"odom": odometry(place, heading, number * NS // 10), "laser": scan}
            command = planner.command(0.1 * number, samples)
            if isinstance(command, Done):
                assert command.reason
                break
            assert math.hypot(command.surge, command.sway) <= SPEED + 1e-9
            assert command.surge >= 0.0 or isinstance(planner, Tasks)  # which holds its position
            assert abs(command.yaw_rate) <= 0.5 + 1e-9
            assert command.depth == 5.0
            assert 0.0 <= planner.progress <= 1.0
            resolved = held(command, samples["odom"])  # type: ignore[arg-type]
            assert resolved.depth is None
            assert abs(resolved.heave) <= 0.8


@examples(20)
@given(piles, st.sampled_from(["astar", "any_angle"]))
def test_paths_keep_their_clearance_from_obstacles(cylinders: list[Cylinder], search: str) -> None:
    """The world's clearance along the whole path is the reference, within half the diagonal of a cell at each end."""
    world = pool(cylinders)
    reported = request(world)
    planner = Avoid(search=search)
    try:
        planner.begin(reported)
    except MissionError:
        return
    path = planner.path
    assert path[0] == pytest.approx((1.0, 1.0))
    assert path[-1] == pytest.approx((19.0, 18.0))
    for a, b in pairwise(path):
        for share in (i / 60 for i in range(61)):
            at = a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])
            assert world.clearance(*at) > reported.clearance - CELL * math.sqrt(2.0)


@settings(examples(6), phases=(Phase.generate,))  # a flight is too long to shrink
@given(piles.filter(bool), st.integers(0, 2**31), st.sampled_from(["known", "unknown"]))
def test_a_vehicle_led_by_a_planner_touches_nothing(cylinders: list[Cylinder], seed: int, text: str) -> None:
    """The vehicle flies in simulated time, with all noise on, among any piles with room between, on the map or not."""
    apart = [a for i, a in enumerate(cylinders) if all(gap(a, b) > 2.2 for b in cylinders[:i])]
    scenario = load_scenario("path_planning", {"master.goal": [19.0, 18.0], "master.map": text})._replace(seed=seed)
    world = pool(apart)._replace(extent=(-3.0, 23.0, -3.0, 23.0))
    plan = prepare(scenario, world)
    vehicle, flight = SimulatedVehicle(scenario, world), Flight(scenario, plan)
    while not flight.reason:
        for _ in range(20):
            vehicle.step()
        command = flight.command(vehicle.time_ns / NS, vehicle.samples, vehicle.simulation.truth())
        assert 0.0 <= command.surge <= 0.8
        vehicle.command(command)
    outcome = flight.outcome(vehicle.time_ns / NS, 0.0)
    assert outcome.reached, outcome.reason
    assert vehicle.simulation.contacts == 0
    assert outcome.least_clearance > math.hypot(*SIX.dimensions[:2]) / 2


def gap(a: Cylinder, b: Cylinder) -> float:
    return math.dist(a[:2], b[:2]) - a.radius - b.radius


class SentPlanner(Planner):
    """A planner that encodes and decodes each sample as on the network, and compares both planners' commands."""

    def __init__(self, planner: Planner, reference: Planner) -> None:
        self.tested, self.reference = planner, reference
        self.commands = 0

    def begin(self, request: PlanRequest) -> None:
        self.tested.begin(request)
        self.reference.begin(request)

    def command(self, time: float, samples: Samples) -> VelocityCommand | Done:
        received, topics = {}, ("odom", *self.reference.subscriptions)
        for topic, sample in samples.items():
            for name, payload in ros.encoder(topic)(sample, ""):
                decode = ros.decoder(name)
                if name in topics:
                    received[name] = decode(payload) if decode else None
        command, other = self.tested.command(time, samples), self.reference.command(time, received)
        if isinstance(command, VelocityCommand):
            assert isinstance(other, VelocityCommand)
            assert other[:4] == pytest.approx(command[:4], abs=2e-3)
            assert other.depth == command.depth
            self.commands += 1
        else:
            assert other == command
        return command


@pytest.mark.parametrize("name", ["path_planning", "task_scheduling"])
def test_a_planner_gives_the_same_commands_over_the_network(name: str) -> None:
    """One planner gets the simulator's records, another of its class the same decoded from ROS 2 messages."""
    scenario = load_scenario(name, {"master.time_limit": 10.0})
    plan, other = prepare(scenario), prepare(scenario)
    compared = SentPlanner(plan.planner, other.planner)
    flight, vehicle = Flight(scenario, plan._replace(planner=compared)), SimulatedVehicle(scenario)
    while not flight.reason:
        for _ in range(20):
            vehicle.step()
        vehicle.command(flight.command(vehicle.time_ns / NS, vehicle.samples, vehicle.simulation.truth()))
    assert flight.reason == "time limit"
    assert compared.commands > 150


def test_a_planner_without_scans_commands_zero_speed() -> None:
    planner = Avoid()
    planner.begin(request(pool([])))
    command = VelocityCommand(depth=5.0)
    assert planner.command(0.0, {"odom": odometry((1.0, 1.0, 5.0), 0.0, 0)}) == command
    free = LaserSample(NS, -1.0, 0.5, (math.inf,) * 5, (0.1, 30.0))
    moving = planner.command(1.0, {"odom": odometry((1.0, 1.0, 5.0), 0.7, NS), "laser": free})
    assert isinstance(moving, VelocityCommand)
    assert moving.surge > 0.5
    assert planner.command(3.0, {"odom": odometry((1.0, 1.0, 5.0), 0.7, 3 * NS), "laser": free}) == command


def test_an_enclosed_planner_gives_up_with_a_reason() -> None:
    planner = Avoid()
    planner.begin(request(pool([]), "unknown"))
    ring = (1.0,) * 120
    command: VelocityCommand | Done = VelocityCommand()
    for tick in range(400):
        now = tick * NS // 10
        scan = LaserSample(now, -math.pi, math.tau / 120, ring, (0.1, 30.0))
        command = planner.command(0.1 * tick, {"odom": odometry((10.0, 10.0, 5.0), 0.7, now), "laser": scan})
        if isinstance(command, Done):
            break
        assert command.surge < 0.2
    assert isinstance(command, Done)
    assert not command.reached
    assert "no path" in command.reason
    assert 190 < tick < 260


def test_an_urgent_task_interrupts_another() -> None:
    """A battery below its limit on the way makes the vehicle charge first, then go on, and return home at the end."""
    planner = Tasks(home=[1.0, 1.0], task=TASKS)
    planner.begin(request(pool([])))
    position, heading, charge = [1.0, 1.0], 0.0, 7.0
    command: VelocityCommand | Done = VelocityCommand()
    for tick in range(4000):
        now = tick * NS // 10
        samples = {
            "odom": odometry((position[0], position[1], 5.0), heading, now),
            "laser": LaserSample(now, -math.pi, math.tau / 60, (math.inf,) * 60, (0.1, 30.0)),
            "battery": BatterySample(now, 15.0, 1.0, charge, 10.0, False),
        }
        command = planner.command(0.1 * tick, samples)
        if isinstance(command, Done):
            break
        charge = 10.0 if planner.status == "charge work" else charge - 0.02
        heading += 0.1 * command.yaw_rate
        position[0] += 0.1 * (command.surge * math.cos(heading) - command.sway * math.sin(heading))
        position[1] += 0.1 * (command.surge * math.sin(heading) + command.sway * math.cos(heading))
    assert command == Done(f"home after {', '.join(planner.finished)}")
    assert planner.finished.count("look") == 1
    assert "charge" in planner.finished
    states = [state for _, state in planner.log]
    first = states.index("charge travel")
    assert states[first - 1] == "look travel", "broken off"
    assert "look travel" in states[first:], "and restarted"
    assert math.dist(position, (1.0, 1.0)) < 0.9


@given(numbers, numbers, st.floats(-4.0, 4.0))
def test_hold_position_commands_towards_the_position(north: float, east: float, heading: float) -> None:
    command = hold_position((north, east), heading, (3.0, -2.0))
    speed = math.hypot(command.surge, command.sway)
    assert speed <= 0.2 + 1e-9
    c, s = math.cos(heading), math.sin(heading)
    to_north, to_east = c * command.surge - s * command.sway, s * command.surge + c * command.sway
    assert to_north * (3.0 - north) + to_east * (-2.0 - east) == pytest.approx(
        speed * math.dist((north, east), (3.0, -2.0)), abs=1e-6
    )


def test_depth_and_heading_holds_become_heave_and_yaw_rate_before_sending() -> None:
    samples = odometry((0.0, 0.0, 4.0), 1.0, 0)
    command = held(VelocityCommand(surge=0.3, yaw_rate=0.1, depth=5.0, heading=1.2), samples)
    assert command[:4] == pytest.approx((0.3, 0.0, 0.4, 0.3))
    assert command[4:] == (None, None)
    assert held(VelocityCommand(heading=-2.0), samples).yaw_rate == -HEADING_HOLD.limit
    plain = VelocityCommand(0.1, 0.2, 0.3, 0.4)
    assert held(plain, samples) == plain


def test_distance_to_a_path_has_the_value_worked_out_by_hand() -> None:
    path = [(0.0, 0.0), (4.0, 0.0), (4.0, 3.0)]
    assert distance_to_path((2.0, -1.0), path) == 1.0
    assert distance_to_path((7.0, 7.0), path) == 5.0
    assert distance_to_path((4.0, 1.5), path) == 0.0
    assert distance_to_path((1.0, 1.0), [(0.0, 0.0), (0.0, 0.0)]) == pytest.approx(math.sqrt(2.0))
