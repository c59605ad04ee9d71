"""The collision shape of a hull: how it turns, bounces, slides and comes to rest."""

from array import array
from collections.abc import Sequence
from math import cos, inf, radians, sin, sqrt
from random import Random
from typing import Any

import pytest

from hil.common.errors import ConfigError
from hil.common.schema import parse
from sim.dynamics import Dynamics, State
from sim.environment.collision import Contact, starts_inside
from sim.environment.obstacles import Box, Cylinder
from sim.environment.terrain import Terrain
from sim.environment.terrain_grid import Grid
from sim.environment.world import World
from sim.rotations import from_euler, to_euler
from sim.simulation import Simulation
from sim.vehicle.collision_shape import Collision, make_shape
from sim.vehicle.vehicle import Vehicle, load_vehicle
from tests.support.collisions import total_energy
from tests.support.flights.runge_kutta import RungeKutta

TORPEDO, _ = load_vehicle("remus100")
FRAME, _ = load_vehicle("bluerov2_heavy")
SEA = World("sea", "test", (-40.0, 40.0, -40.0, 40.0), 20.0)
WALLED = SEA._replace(walls=True)
DT = 0.0025
BASIN = array("f", [9.0] * 169)


def ball(collision: Collision, **changes: object) -> Vehicle:
    """Return a ball of 10 kg and 0.2 m radius in water of negligible drag, with a buoyancy of at most 4.7 kg."""
    keys = collision._replace(shape="spheres", spheres=((0.0, 0.0, 0.0, 0.2),))
    defaults: dict[str, object] = {
        "neutrally_buoyant": False, "mass": 10.0, "volume": 4.7 / 1025.0, "collision": keys,
        "center_of_buoyancy": (0.0, 0.0, 0.0), "center_of_gravity": (0.0, 0.0, 0.0), "inertia": (0.2, 0.2, 0.2),
        "added_mass": (3.0, 3.0, 3.0, 0.1, 0.1, 0.1), "linear_damping": (0.0,) * 6, "quadratic_damping": (0.0,) * 6,
    }  # fmt: skip
    return FRAME._replace(**{**defaults, **changes})  # type: ignore[arg-type]


def test_torpedoes_are_capsules_and_frames_are_boxes() -> None:
    capsule, box = (make_shape(Collision(), vehicle.dimensions) for vehicle in (TORPEDO, FRAME))
    length, width, _ = TORPEDO.dimensions
    assert capsule.points == (
        (0.5 * (length - width), 0.0, 0.0, 0.5 * width),
        (-0.5 * (length - width), 0.0, 0.0, 0.5 * width),
    )
    assert capsule.reach == pytest.approx(0.5 * length)
    assert [point[:3] for point in box.points[:8]] == [
        tuple(0.5 * s * size for s, size in zip(signs, FRAME.dimensions, strict=True))
        for signs in [(a, b, c) for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)]
    ]
    assert box.extent == pytest.approx((*(0.5 * size for size in FRAME.dimensions), 0.0))
    assert make_shape(Collision("box"), TORPEDO.dimensions).extent[0] == 0.5 * length
    assert {point[3] for point in box.points[8:]} == {0.5 * min(FRAME.dimensions)}, "rods within it"


@pytest.mark.parametrize("vehicle", [TORPEDO, FRAME])
def test_the_bounding_extent_contains_the_hull(vehicle: Vehicle) -> None:
    shape, chance = make_shape(Collision(), vehicle.dimensions), Random(1)
    for _ in range(200):
        n = [chance.gauss(0.0, 1.0) for _ in range(3)]
        size = sqrt(sum(x * x for x in n))
        n = [x / size for x in n]
        most = max(sum(a * b for a, b in zip(point[:3], n, strict=True)) + point[3] for point in shape.points)
        bound = sum(abs(a) * b for a, b in zip(n, shape.extent[:3], strict=True)) + shape.extent[3]
        assert most <= bound + 1e-12
        assert bound <= shape.reach * sqrt(3.0)


@pytest.mark.parametrize("keys", [{"shape": "spheres"}, {"spheres": [[0, 0, 0, 1]]}, {"friction": -1}, {"bounce": 1}])
def test_invalid_collision_keys_are_refused(keys: dict[str, object]) -> None:
    with pytest.raises(ConfigError, match="collision: "):
        parse(keys, Collision, "collision")


def test_a_nose_pitched_into_the_seabed_touches_it() -> None:
    """The nose of a vehicle 69 degrees down, with its origin half a metre above the seabed, is 0.25 m in it."""
    down = from_euler(0.0, radians(-69.0), 0.0)
    assert starts_inside(TORPEDO, SEA, (0.0, 0.0, 19.5), down)
    assert not starts_inside(TORPEDO, SEA, (0.0, 0.0, 19.5))
    contact = Contact(TORPEDO, SEA, Dynamics(TORPEDO, 1025.0, 9.8).inverse_mass)
    touch = contact.find(State((0.0, 0.0, 19.5), down))[0]
    half = 0.5 * (TORPEDO.dimensions[0] - TORPEDO.dimensions[1])
    assert touch.lever[0] > half
    assert touch.depth == pytest.approx(half * 0.93358 + 0.5 * TORPEDO.dimensions[1] - 0.5, abs=1e-4)


@pytest.mark.parametrize("pitch", [20.0, -20.0])
def test_a_nose_or_stern_that_touches_turns_the_vehicle_level(pitch: float) -> None:
    contact = Contact(TORPEDO, SEA, Dynamics(TORPEDO, 1025.0, 9.8).inverse_mass, DT)
    state = State((0.0, 0.0, 19.67), from_euler(0.0, radians(pitch), 0.0), (0.0, 0.0, 0.3, 0.0, 0.0, 0.0))
    assert contact.resolve(state)
    assert state.nu[4] * pitch < 0.0
    assert contact.impulse[4] * pitch < 0.0


def test_a_pile_that_hits_the_flank_turns_the_vehicle() -> None:
    """A vehicle moving sideways hits a thin pile ahead of its middle: the bow is stopped, the stern goes on."""
    world = SEA._replace(cylinder=(Cylinder(0.4, 1.0, 0.05),))
    contact = Contact(TORPEDO, world, Dynamics(TORPEDO, 1025.0, 9.8).inverse_mass, DT)
    state = State((0.0, 1.0 - 0.05 - 0.094, 5.0), nu=(0.0, 0.5, 0.0, 0.0, 0.0, 0.0))
    assert contact.resolve(state)
    assert state.nu[5] < -0.1
    assert state.nu[1] > 0.0
    assert all(touch.depth < 1e-6 for touch in contact.find(state))


@pytest.mark.parametrize("restitution", [0.3, 0.5, 0.8])
def test_a_bounce_has_the_height_of_its_restitution(restitution: float) -> None:
    simulation = Simulation(ball(Collision(restitution=restitution)), SEA, {}, position=(0.0, 0.0, 17.8))
    highest, speeds = 20.0, []
    for _ in range(4000):
        simulation.step((1500,) * 8)
        if simulation.touching:
            speeds.append(simulation.state.nu[2])
        if len(speeds) == 1:
            highest = min(highest, simulation.state.position[2])
    assert len(speeds) > 1
    assert (19.8 - highest) / (19.8 - 17.8) == pytest.approx(restitution**2, rel=0.02)


@pytest.mark.parametrize("friction", [0.0, 0.2, 0.5])
def test_sliding_along_a_wall_reduces_speed(friction: float) -> None:
    """A ball that meets a wall at an angle loses friction (1 + e) times its closing speed, and takes a spin."""
    vehicle = ball(Collision(friction=friction, restitution=0.4), neutrally_buoyant=True)
    contact = Contact(vehicle, WALLED, Dynamics(vehicle, 1025.0, 9.8).inverse_mass, DT)
    state = State((39.801, 0.0, 5.0), nu=(0.5, 1.0, 0.0, 0.0, 0.0, 0.0))
    assert contact.resolve(state)
    assert state.nu[0] == pytest.approx(-0.4 * 0.5)
    lost = friction * 1.4 * 0.5
    assert state.nu[1] == pytest.approx(1.0 - lost)
    assert state.nu[5] == pytest.approx(-0.2 * 13.0 * lost / 0.3)


def test_friction_stops_a_slide_on_the_seabed() -> None:
    """A vehicle at 1 m/s, flat on the seabed, comes to rest within v^2 / (2 mu g'), and stays."""
    keys: dict[str, Any] = {
        "linear_damping": (0.0,) * 6,
        "quadratic_damping": (0.0,) * 6,
        "added_mass": (6.0,) * 3 + (0.1,) * 3,
    }
    vehicle = FRAME._replace(neutrally_buoyant=False, mass=FRAME.mass + 4.0, collision=Collision(friction=0.3), **keys)
    half = 0.5 * vehicle.dimensions[2]
    simulation = Simulation(vehicle, SEA, {}, position=(0.0, 0.0, 20.0 - half))
    simulation.state.nu = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for _ in range(1600):
        simulation.step((1500,) * 8)
    position = tuple(simulation.state.position)
    excess = (vehicle.mass - vehicle.volume * SEA.density) * SEA.gravity
    way = 0.5 * (vehicle.mass + 6.0) / (0.3 * excess)
    assert position[0] == pytest.approx(way, rel=0.05)
    for _ in range(400):
        simulation.step((1500,) * 8)
    assert simulation.state.position == pytest.approx(position, abs=1e-5)
    assert simulation.touching
    Simulation(vehicle, SEA, {}, position=position)  # it may start where it came to rest


ATTITUDES = ((0.0, 0.0, 0.0), (0.4, 0.3, 0.2), (1.2, -0.9, 2.0))


@pytest.mark.parametrize(
    ("restitution", "friction", "attitude"),
    [(0.0, 2.0, ATTITUDES[2]), (0.5, 0.4, ATTITUDES[2]), (1.0, 2.0, ATTITUDES[1])],
)
def test_tumbling_on_the_seabed_gains_no_energy(restitution: float, friction: float, attitude: Sequence[float]) -> None:
    """A box falls on a corner, tumbles and bounces without any drag; 48 J are to be lost.

    A single step may add a little, as much as the way of that step; over the whole fall no energy is added.
    """
    vehicle = ball(Collision(restitution=restitution, friction=friction))
    vehicle = vehicle._replace(collision=Collision(friction=friction, restitution=restitution))
    dynamics = RungeKutta(vehicle, SEA.density, SEA.gravity)
    contact = Contact(vehicle, SEA, dynamics.inverse_mass, DT)
    state = State((0.0, 0.0, 19.0), from_euler(*attitude), (0.5, -0.3, 0.2, 0.4, 0.7, -0.2))
    first = last = total_energy(dynamics, state)
    most = gained = 0.0
    for _ in range(1200):
        dynamics.step(state, (0.0,) * 6, (0.0, 0.0, 0.0), DT)
        contact.resolve(state)
        now = total_energy(dynamics, state)
        most, gained, last = max(most, now - last), gained + max(0.0, now - last), now
    assert contact.count > 0
    assert last < first - 35.0
    assert gained < 1.0
    assert most < (2e-3 if restitution < 1.0 else 0.4)


def test_distant_obstacles_are_not_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    """Obstacles within 500 m, of thousands on a chart, are found wherever the vehicle comes from."""
    piles = tuple(Cylinder(20.0 * k, 40.0, 1.0) for k in range(1000))
    measured: list[float] = []
    separation = Cylinder.separation

    def counted(pile: Cylinder, north: float, east: float) -> tuple[float, float, float]:
        measured.append(pile.north)
        return separation(pile, north, east)

    world = World("piles", "test", (-100.0, 20_000.0, -100.0, 100.0), 50.0, cylinder=piles)
    vehicle, _ = load_vehicle("paper_six")
    contact = Contact(vehicle, world, Dynamics(vehicle, 1025.0, 9.8).inverse_mass)
    monkeypatch.setattr(Cylinder, "separation", counted)
    for north in (0.0, 460.0, 5000.0, 19_000.0):
        measured.clear()
        assert not contact.resolve(State((north, 0.0, 10.0)))
        assert 0 < len(measured) < 70
        assert contact.clearance()[2] < 500.0
    assert contact.resolve(State((9980.0, 40.0, 10.0)))


@pytest.mark.parametrize(("friction", "restitution"), [(0.0, 0.0), (0.1, 0.5), (0.2, 0.8), (0.3, 0.0)])
@pytest.mark.parametrize(("depth", "since"), [(0.001, 0.001), (0.02, DT)], ids=["within the step", "deeper"])
def test_from_the_impact_on_the_ball_moves_with_its_new_velocity(
    friction: float, restitution: float, depth: float, since: float
) -> None:
    """It comes at 1 m/s and has passed the wall by `depth`; what it gained since the impact does not bounce.

    If it is deeper than its motion explains, it is moved out to the wall's side.
    """
    vehicle = ball(Collision(friction=friction, restitution=restitution), neutrally_buoyant=True)
    contact = Contact(vehicle, WALLED, Dynamics(vehicle, 1025.0, 9.8).inverse_mass, DT)
    state = State((39.8 + depth, 3.0, 5.0), nu=(1.0, 1.5, 0.0, 0.0, 0.0, 0.0))
    state.nu_dot = [8.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    assert contact.resolve(state)
    gained = 8.0 * since if restitution else 0.0
    closing = 1.0 - gained
    north = gained - restitution * closing
    lost = friction * (1.0 + restitution) * closing
    turn = -0.2 * 13.0 * lost / 0.3
    assert state.nu == pytest.approx([north, 1.5 - lost, 0.0, 0.0, 0.0, turn], abs=1e-9)
    assert list(contact.impulse) == pytest.approx(
        [13.0 * (-restitution - 1.0) * closing, -13.0 * lost, 0.0, 0.0, 0.0, 0.3 * turn], abs=1e-8
    )
    passed = 39.8 + depth + since * (north - 1.0)
    passed = min(passed, 39.8) if depth > since else passed
    assert list(state.position) == pytest.approx([passed, 3.0 - since * lost, 5.0], abs=1e-6)
    assert to_euler(state.quaternion) == pytest.approx((0.0, 0.0, since * turn), rel=1e-5)
    assert (contact.what, contact.count, contact.clearance()[3]) == ("the north wall", 1, -inf)


def test_a_contact_is_counted_at_its_begin_and_has_the_name_of_what_is_touched() -> None:
    world = SEA._replace(cylinder=(Cylinder(3.0, 0.0, 1.0, name="the pile"),))
    contact = Contact(ball(Collision()), world, Dynamics(ball(Collision()), 1025.0, 9.8).inverse_mass, DT)
    places = {"pile": (1.81, 0.0, 5.0), "bed": (0.0, 0.0, 19.81), "water": (0.0, 0.0, 5.0)}
    found = []
    for place in ("water", "pile", "pile", "water", "bed", "water", "pile"):
        touching = contact.resolve(State(places[place]))
        assert touching == contact.touching == (place != "water")
        found.append((contact.count, contact.what))
    pile, bed = "the pile", "the seabed"
    assert found == [(0, ""), (1, pile), (1, pile), (1, pile), (2, bed), (2, bed), (3, pile)]


def test_a_vehicle_placed_deep_in_the_ground_is_lifted_and_one_that_moved_there_turns() -> None:
    inverse = Dynamics(TORPEDO, 1025.0, 9.8).inverse_mass
    for depth, turns in ((19.5, False), (19.252, True)):
        contact, down = Contact(TORPEDO, SEA, inverse, DT), from_euler(0.0, radians(-69.0), 0.0)
        state = State((3.0, 4.0, depth), down)
        assert contact.resolve(state)
        assert (list(state.quaternion) != list(down)) == turns, depth
        assert max([touch.depth for touch in contact.find(state)], default=0.0) < 1e-5
        if not turns:
            assert list(state.position[:2]) == [3.0, 4.0]


@pytest.mark.parametrize("position", [(0.0, 0.0, 5.0), (-25.0, 3.0, 5.0), (10.0, -4.0, 1.0), (27.0, 0.0, 5.0)])
def test_no_contact_is_possible_within_the_clearance(position: tuple[float, float, float]) -> None:
    world = SEA._replace(
        cylinder=(Cylinder(30.0, 0.0, 1.0), Cylinder(-30.0, 0.0, 2.0)), box=(Box(0.0, 30.0, 2.0, 4.0),)
    )
    contact = Contact(TORPEDO, world, Dynamics(TORPEDO, 1025.0, 9.8).inverse_mass)
    assert not contact.resolve(State(position))
    north, east, free, floor = contact.clearance()
    assert (north, east) == position[:2]
    sides = [one.separation(north, east)[0] for one in world.upright()]
    assert free == pytest.approx(min(sides) - contact.radius)
    assert floor == pytest.approx(20.0, abs=1e-4)
    assert floor < 20.0
    for turn in range(16):
        place = (north + 0.99 * free * cos(0.3927 * turn), east + 0.99 * free * sin(0.3927 * turn), 5.0)
        assert Contact(TORPEDO, world, contact.inverse_mass).find(State(place)) == []
    bare = Contact(TORPEDO, SEA, contact.inverse_mass)
    assert not bare.resolve(State(position))
    assert bare.clearance() == (0.0, 0.0, inf, floor)


@pytest.mark.parametrize("axes", [(0,), (1,), (0, 1)])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_at_an_edge_of_the_grid_the_motion_across_it_ends_and_that_along_it_goes_on(
    axes: tuple[int, ...], side: float
) -> None:
    """A basin 5 m deep around which the seabed is above the vehicle."""
    world = World("basin", "", (-20.0, 20.0) * 2, 4.0, terrain=Terrain(Grid(-6.0, -6.0, 1.0, 13, 13), BASIN, 4.0))
    vehicle = ball(Collision(friction=0.0, restitution=0.0), neutrally_buoyant=True)
    contact = Contact(vehicle, world, Dynamics(vehicle, 1025.0, 9.8).inverse_mass, DT)
    velocity = [side * 4.0 if axis in axes else 0.4 for axis in (0, 1)]
    state = State((0.0, 0.0, 7.0), nu=(*velocity, 0.0, 0.0, 0.0, 0.0))
    for _ in range(4000):
        before = list(state.position)
        state.position = [x + DT * v for x, v in zip(before, (*velocity, 0.0), strict=True)]
        if contact.resolve(state):
            break
    assert (contact.what, contact.count) == ("the seabed", 1)
    for axis in (0, 1):
        moved = before[axis] + DT * velocity[axis]
        assert state.position[axis] == pytest.approx(before[axis] if axis in axes else moved, abs=1e-12)
        if axes != (0, 1):  # in a corner the second impulse turns the ball
            assert state.nu[axis] == pytest.approx(0.0 if axis in axes else 0.4, abs=1e-3)
        assert 5.0 < abs(state.position[axis]) < 6.5 or axis not in axes
    assert state.position[2] == 7.0
    assert contact.clearance()[3] == -inf
