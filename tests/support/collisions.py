"""The energy of a vehicle, and the check that its collisions do not add any."""

from random import Random

from sim.dynamics import Dynamics, State
from sim.environment.collision import Contact
from sim.environment.world import World
from sim.rotations import normalise
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
