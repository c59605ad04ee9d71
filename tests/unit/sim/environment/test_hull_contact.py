"""The collision shape of a hull: how it turns, bounces, slides and comes to rest."""

from collections.abc import Sequence
from math import radians, sqrt
from random import Random
from typing import Any

import pytest

from hil.common.errors import ConfigError
from hil.common.schema import parse
from sim.dynamics import Dynamics, State
from sim.environment.collision import Contact, starts_inside
from sim.environment.obstacles import Cylinder
from sim.environment.world import World
from sim.rotations import from_euler
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
    for _ in range(6000):
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
    for _ in range(2800):
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
