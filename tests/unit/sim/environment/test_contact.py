"""Collisions of a vehicle with walls, obstacles and the seabed."""

from collections.abc import Sequence
from random import Random

import pytest

from sim.dynamics import Dynamics, State
from sim.environment.collision import Contact, starts_inside
from sim.environment.contact.impulses import Touch
from sim.environment.contact.solids import distance_to
from sim.environment.obstacles import Box, Cylinder
from sim.environment.world import World
from sim.rotations import normalise, rotate
from sim.simulation import Simulation
from sim.vehicle.collision_shape import Collision
from sim.vehicle.vehicle import load_vehicle
from tests.support.collisions import check_collisions_add_no_energy, drive_against_obstacles, sinking

VEHICLE, _ = load_vehicle("paper_six")
SEA = World(
    "sea", "test", (-10.0, 10.0, -10.0, 10.0), 10.0,
    cylinder=(Cylinder(3.0, 0.0, 1.0), Cylinder(-5.0, 0.0, 1.5, top=6.0)), box=(Box(0.0, 4.0, 3.0, 1.0, 0.5),),
)  # fmt: skip
STEP_NS = 5_000_000  # twice the usual step: harder for collisions, and half the steps


def test_a_collision_never_adds_energy() -> None:
    """Energy falls or stays in random states inside things, with an uneven mass matrix."""
    assert check_collisions_add_no_energy(VEHICLE, SEA, 2000) > 200


def closing_speed(touch: Touch, nu: Sequence[float]) -> float:
    """Return how fast (m/s) a point of the hull moves into what it touches."""
    (x, y, z), (u, v, w, p, q, r) = touch.lever, nu
    velocity = u + q * z - r * y, v + r * x - p * z, w + p * y - q * x
    return -sum(a * b for a, b in zip(touch.normal, velocity, strict=True))


def test_after_a_collision_no_contact_point_closes() -> None:
    dynamics = Dynamics(VEHICLE, 1025.0, 9.8)
    contact = Contact(VEHICLE, SEA, dynamics.inverse_mass)
    state = State((1.75, 0.0, 5.0), normalise((1.0, 0.2, 0.1, 0.4)), (1.0, -0.8, 0.2, 0.1, 0.0, 0.3))
    assert rotate(state.quaternion, state.nu[:3])[0] > 0.5  # northwards, into the cylinder at 3 m
    touches = contact.find(state)
    assert max(closing_speed(touch, state.nu) for touch in touches) > 0.5
    assert contact.resolve(state)
    assert max(closing_speed(touch, state.nu) for touch in touches) < 1e-4
    assert all(touch.depth < 1e-5 for touch in contact.find(state))
    state.nu = nu = [state.nu[0] - 3.0, *state.nu[1:]]  # it moves away again: nothing stops it
    contact.resolve(state)
    assert state.nu == nu


@pytest.mark.parametrize("heading", [0.0, 2.6])
def test_a_vehicle_does_not_pass_through_walls_and_obstacles(heading: float) -> None:
    """A vehicle that moves ahead at 1 m/s for 20 s within walls slides along obstacles, never into them."""
    world = SEA._replace(walls=True)
    simulation = Simulation(VEHICLE, world, {}, dt_ns=STEP_NS, position=(0.0, 0.0, 5.0), heading=heading)
    drive_against_obstacles(simulation, 4000)


def test_a_vehicle_rests_on_top_of_a_stump() -> None:
    simulation = Simulation(sinking(VEHICLE, drag=5.0), SEA, {}, position=(-5.0, 0.0, 2.0))
    for _ in range(4000):
        simulation.step((1500,) * 6)
    assert simulation.state.position[2] == pytest.approx(6.0 - 0.117, abs=1e-4)
    assert simulation.touching
    assert simulation.contacts < 10  # it rocks from corner to corner; lying still is one touch
    assert max(map(abs, simulation.state.nu)) < 1e-4


def test_a_vehicle_passes_below_a_pontoon_and_stops_at_its_underside() -> None:
    """A vehicle is clear below a pontoon 2 m deep, pushed down when it rises, and out of its side from beside."""
    pontoon = Box(0.0, 0.0, 6.0, 6.0, top=-1.0, bottom=2.0)
    world = World("harbour", "test", (-20.0, 20.0, -20.0, 20.0), 10.0, box=(pontoon,))
    inverse = Dynamics(VEHICLE, 1025.0, 9.8).inverse_mass
    half, front = 0.5 * VEHICLE.dimensions[2], 0.5 * VEHICLE.dimensions[0]
    for point, free in (((0.0, 0.0, 2.01 + half), True), ((0.0, 0.0, 1.9 + half), False), ((3.1, 0.0, 1.0), False)):
        contact, state = Contact(VEHICLE._replace(collision=Collision(restitution=0.0)), world, inverse), State(point)
        state.nu = [0.0, 0.0, -0.5, 0.0, 0.0, 0.0]
        assert contact.resolve(state) != free
        assert starts_inside(VEHICLE, world, point) != free
        if point[2] > 2.0 and not free:
            assert state.position == pytest.approx((0.0, 0.0, 2.0 + half), abs=1e-5)
            assert state.nu[2] == pytest.approx(0.0, abs=1e-4)
        elif not free:
            assert state.position == pytest.approx((3.0 + front, 0.0, 1.0), abs=1e-5)
    above_rim = distance_to(Cylinder(1.0, 0.0, 2.0, top=5.0), 4.0, 4.0, 1.0)  # 3 m beside it and 4 m above
    assert above_rim == pytest.approx((5.0, 0.36, 0.48, -0.8))
    assert world.clearance(0.0, 0.0, 5.0, height=1.0) == float("inf")
    assert world.clearance(0.0, 0.0, 5.0) == -3.0
    assert world.foot(pontoon, 0.0, 0.0) == 2.0
    assert world.foot(pontoon._replace(bottom=50.0), 0.0, 0.0) == 10.0


def test_contacts_do_not_depend_on_earlier_positions() -> None:
    """A path across 300 piles in 400 m has the same contacts as with a new Contact at each step."""
    random = Random(3)
    piles = tuple(Cylinder(random.uniform(-200, 200), random.uniform(-200, 200), 1.0) for _ in range(300))
    world = World("piles", "test", (-200.0, 200.0, -200.0, 200.0), 30.0, cylinder=piles)
    inverse = Dynamics(VEHICLE, 1025.0, 9.8).inverse_mass
    contact, touched = Contact(VEHICLE, world, inverse), 0
    for step in range(1600):
        position = (0.25 * step - 200.0, 150.0 * (step / 1600.0) - 60.0, 5.0)
        state, fresh = State(position), State(position)
        assert contact.resolve(state) == Contact(VEHICLE, world, inverse).resolve(fresh)
        assert state.position == fresh.position
        touched += contact.touching
    assert touched > 10
