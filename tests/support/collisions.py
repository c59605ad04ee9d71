"""The energy of a vehicle, and checks that its collisions add none and that it does not pass into obstacles."""

from math import pi, remainder
from random import Random

from sim.dynamics import Dynamics, State
from sim.environment.collision import Contact
from sim.environment.world import World
from sim.rotations import normalise, to_euler
from sim.simulation import Simulation
from sim.vehicle.collision_shape import Collision
from sim.vehicle.vehicle import Vehicle


def kinetic_energy(dynamics: Dynamics, state: State) -> float:
    """Return the kinetic energy (J) with added mass."""
    rows = zip(dynamics.mass, state.nu, strict=True)
    return 0.5 * sum(v * sum(m * x for m, x in zip(row, state.nu, strict=True)) for row, v in rows)


def total_energy(dynamics: Dynamics, state: State) -> float:
    """Return the kinetic energy and that of the vehicle's weight in water, submerged (J)."""
    return kinetic_energy(dynamics, state) - (dynamics.weight - dynamics.hull.full) * state.position[2]


def check_collisions_add_no_energy(vehicle: Vehicle, world: World, count: int) -> int:
    """Resolve the contacts of `count` random states with an uneven mass matrix; return how many touched something."""
    skewed = vehicle._replace(center_of_gravity=(0.03, -0.02, 0.05))
    dynamics = Dynamics(skewed, 1025.0, 9.8)
    random, contacts = Random(1), 0
    for _ in range(count):
        contact = Contact(skewed, world, dynamics.inverse_mass)
        place = (random.uniform(-8, 8), random.uniform(-8, 8), random.uniform(4, 10.5))
        state = State(place, normalise([random.gauss(0, 1) for _ in range(4)]), [random.gauss(0, 2) for _ in range(6)])
        before = kinetic_energy(dynamics, state)
        contacts += contact.resolve(state)
        assert kinetic_energy(dynamics, state) <= before * (1.0 + 1e-12)
    return contacts


def sinking(vehicle: Vehicle, collision: Collision = Collision(restitution=0.0), drag: float = 0.0) -> Vehicle:
    """Return `vehicle` 5 kg too heavy, with nothing that would turn it, and with only this linear drag."""
    return vehicle._replace(
        neutrally_buoyant=False, volume=4.7 / 1025.0, center_of_buoyancy=(0.0, 0.0, 0.0),
        added_mass=(6.0, 6.0, 6.0, 0.1, 0.1, 0.1),
        linear_damping=(drag,) * 6, quadratic_damping=(0.0,) * 6, collision=collision,
    )  # fmt: skip


def drive_against_obstacles(simulation: Simulation, steps: int) -> None:
    """Drive ahead at 1 m/s on the heading of the start, ever deeper: along what is in the way, never into it."""
    heading = to_euler(simulation.state.quaternion)[2]
    for step in range(steps):
        off = remainder(heading - to_euler(simulation.state.quaternion)[2], 2.0 * pi)
        turn = round(max(-100.0, min(100.0, 300.0 * off - 150.0 * simulation.state.nu[5])))
        left, right, down_us = 1650 + turn, 1650 - turn, 1500 + step // 40
        simulation.step((right, left, right, left, down_us, down_us))
        assert step % 4 or all(touch.depth < 1e-3 for touch in simulation._contact.find(simulation.state))
        assert max(map(abs, simulation.state.nu)) < 20.0
    assert simulation.contacts > 0
