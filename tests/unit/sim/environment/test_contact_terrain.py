"""A vehicle on relief: it does not enter slopes and steps, slides, and gains no energy."""

from array import array
from math import atan, cos, nan, sin, sqrt
from random import Random

import pytest

from sim.dynamics import Dynamics, State
from sim.environment.collision import Contact
from sim.environment.contact.seabed import SeabedContact
from sim.environment.relief import Fractal, Ridge, Sinusoid, Slope, Step
from sim.environment.terrain import Terrain, covering
from sim.environment.terrain_grid import Grid
from sim.environment.world import World
from sim.rotations import matrix, normalise, rotate
from sim.simulation import Simulation
from sim.vehicle.collision_shape import Collision, make_shape
from sim.vehicle.vehicle import load_vehicle
from tests.support.collisions import check_collisions_add_no_energy, drive_against_obstacles, sinking, total_energy
from tests.support.flights.runge_kutta import RungeKutta

VEHICLE, _ = load_vehicle("paper_six")
EXTENT = (-15.0, 15.0, -15.0, 15.0)
SMOOTH = Collision(friction=0.0, restitution=0.0)
STEP_NS = 5_000_000  # twice the usual step: harder for collisions, and half the steps


def world_of(rule: Slope | Ridge | Sinusoid | Fractal | Step, holes: int = 0) -> World:
    grid = covering(EXTENT, rule.resolution)
    depths, chance = rule.depths(grid), Random(holes)
    for _ in range(holes):
        depths[chance.randrange(len(depths))] = nan
    return World("relief", "test", EXTENT, 8.0, terrain=Terrain(grid, depths, 8.0))


def deepest(contact: Contact, state: State) -> float:
    """Return how far (m) the hull is in the seabed, 0 if it is not."""
    return max([touch.depth for touch in contact.find(state)], default=0.0)


def test_a_collision_never_adds_kinetic_energy() -> None:
    """The states are random in rough ground, with an uneven mass matrix."""
    assert check_collisions_add_no_energy(VEHICLE, world_of(Fractal(8.0, 1.0, seed=2)), 500) > 100


@pytest.mark.parametrize("heading", [0.0, 0.7, -2.2])
def test_a_vehicle_in_a_slope_is_moved_out_along_the_normal(heading: float) -> None:
    slope = Slope(8.0, 0.5, heading)
    world, dynamics = world_of(slope), Dynamics(VEHICLE, 1025.0, 9.8)
    contact = Contact(VEHICLE, world, dynamics.inverse_mass)
    state = State(
        (0.5, -0.5, world.seabed(0.5, -0.5) - 0.1), normalise((1.0, 0.2, 0.1, 0.4)), (1.0, -0.8, 0.6, 0.1, 0.0, 0.3)
    )
    before = list(state.position)
    assert contact.resolve(state)
    displacement = [a - b for a, b in zip(state.position, before, strict=True)]
    out = [x / sqrt(1.25) for x in (0.5 * cos(heading), 0.5 * sin(heading), -1.0)]
    across = sum(a * b for a, b in zip(displacement, out, strict=True))
    assert across > 0.1
    assert sqrt(sum(x * x for x in displacement)) == pytest.approx(across, abs=1e-4)  # nodes are 32-bit floats
    assert deepest(contact, state) < 1e-5
    velocity = rotate(state.quaternion, state.nu[:3])
    assert sum(v * n for v, n in zip(velocity, out, strict=True)) >= 0.0


def test_a_vehicle_slides_down_a_slope() -> None:
    """The vehicle, without friction, gains speed along the slope as a body on an incline does, added mass included."""
    vehicle = sinking(VEHICLE, SMOOTH)
    simulation = Simulation(vehicle, world_of(Slope(6.0, 0.3)), {}, position=(-10.0, 0.0, 2.0))
    speeds = []
    for step in range(1800):
        simulation.step((1500,) * 6)
        if step in (1000, 1400):
            speeds.append(rotate(simulation.state.quaternion, simulation.state.nu[:3]))
    assert 1 <= simulation.contacts < 10  # from corner to corner
    angle, weight = atan(0.3), (vehicle.mass - 4.7) * 9.80665
    gained = [b - a for a, b in zip(*speeds, strict=True)]
    expected = weight * sin(angle) / (vehicle.mass + 6.0)  # m/s in the second between
    assert gained == pytest.approx([expected * cos(angle), 0.0, expected * sin(angle)], rel=0.01, abs=1e-4)


RULES = [
    (Slope(8.0, 1.5, 0.4, resolution=0.5), 0),
    (Ridge(8.0, 3.0, 0.6, 1.0, resolution=0.25), 3),
    (Sinusoid(8.0, 0.7, 4.0, 1.0, resolution=0.25), 0),
    (Fractal(8.0, 1.2, seed=3, resolution=0.5), 3),
    (Step(8.0, 2.0, 0.3, resolution=0.5), 0),
]


@pytest.mark.parametrize(("rule", "holes"), RULES, ids=lambda value: type(value).__name__)
def test_a_run_over_relief_gains_no_energy(rule: Slope, holes: int) -> None:
    """It falls on relief, slides and meets walls. Where a slope gets steeper a step may add what its own way is worth.

    Over the whole ride energy is lost, and nothing is in the seabed, which is checked at every eighth step.
    """
    world, vehicle = world_of(rule, holes), sinking(VEHICLE, SMOOTH)
    dynamics = RungeKutta(vehicle, world.density, world.gravity)
    contact = Contact(vehicle, world, dynamics.inverse_mass)
    state = State((2.35, -3.45, 5.5), nu=(0.7, -0.9, 4.7, 0.0, 0.0, 0.0))
    weight_in_water = dynamics.weight - dynamics.hull.full
    first = last = total_energy(dynamics, state)
    touched, gained = 0, 0.0
    for step in range(600):
        before = state.position
        dynamics.step(state, (0.0,) * 6, (0.0, 0.0, 0.0), 0.0025)
        touched += contact.resolve(state)
        way = sum((a - b) ** 2 for a, b in zip(state.position, before, strict=True)) ** 0.5
        gain = total_energy(dynamics, state) - last
        assert gain <= weight_in_water * way + 1e-3
        gained += max(0.0, gain)
        last += gain
        assert step % 8 or deepest(contact, state) < 2e-3
    assert touched > 50
    assert last < first - 1.0
    assert gained < 0.02 * (first - last)


@pytest.mark.parametrize("heading", [1.2, 4.0])
def test_a_vehicle_does_not_pass_through_steps(heading: float) -> None:
    """A vehicle moves ahead in a basin with an edge and pillars without data, on one heading: along them, never in."""
    grid = Grid(-6.0, -6.0, 1.0, 13, 13)
    depths = array("f", [9.0] * 169)
    depths[6 * 13 + 9] = depths[9 * 13 + 5] = nan
    world = World("basin", "test", EXTENT, 4.0, terrain=Terrain(grid, depths, 4.0))
    simulation = Simulation(VEHICLE, world, {}, dt_ns=STEP_NS, position=(0.0, 0.0, 7.0), heading=heading)
    drive_against_obstacles(simulation, 2500)


def test_points_along_a_hull_are_in_the_ground_by_their_own_depths() -> None:
    """At random attitudes along a way over steep ground, the first point that is deeper than a limit is found."""
    ground = world_of(Fractal(9.0, 3.0, seed=5, resolution=2.0)).terrain
    assert ground
    contact, chance = SeabedContact(ground, make_shape(Collision(), load_vehicle("remus100")[0].dimensions)), Random(4)
    level = contact.points((1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0))
    half = level.spheres[0][0]
    assert sorted(x for x, *_ in level.spheres) == [-half, 0.0, half], "for nodes 2 m apart"
    for step in range(200):
        north, east = 9.0 * sin(0.1 * step), 7.0 * cos(0.07 * step)
        down = ground.depth(north, east) - chance.uniform(-0.5, 1.0)
        points = contact.points(matrix(normalise([chance.gauss(0.0, 1.0) for _ in range(4)])))
        below = [down + z - ground.depth(north + x, east + y) for x, y, z in points.surface]
        deep = [-a * ground.normal(north + x, east + y)[2] for a, (x, y, _) in zip(below, points.surface, strict=True)]
        assert contact.max_penetration((north, east, down), points) == max(below)
        for limit in (0.0, 0.1, 0.2, 0.4):
            first = next((point for point, depth in zip(points.surface, deep, strict=True) if depth > limit), None)
            assert contact.step_at((north, east, down), points, limit) == first
