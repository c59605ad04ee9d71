"""Convert a vehicle's parameters to the plant model that controllers use."""

from hil.autonomy.control.controller import Wrench
from hil.autonomy.control.model import Plant
from sim.matrices import Matrix, square
from sim.vehicle.vehicle import Vehicle, displaced_volume, mass_matrix


def plant_of(vehicle: Vehicle, density: float, gravity: float) -> Plant:
    """Return the plant model of `vehicle` in water of `density` kg/m³ under `gravity` m/s².

    Only the diagonals of full matrices are used.
    """
    x, y, z, *_ = _diagonal(square(vehicle.added_mass, 6))
    return Plant(
        inertia=_diagonal(mass_matrix(vehicle)),
        linear_damping=_diagonal(square(vehicle.linear_damping, 6)),
        quadratic_damping=_diagonal(square(vehicle.quadratic_damping, 6)),
        weight=vehicle.mass * gravity,
        buoyancy=density * displaced_volume(vehicle, density) * gravity,
        center_of_gravity=vehicle.center_of_gravity,
        center_of_buoyancy=vehicle.center_of_buoyancy,
        translational_added_mass=(x, y, z),
        munk_share=vehicle.munk_share,
    )


def _diagonal(matrix: Matrix) -> Wrench:
    x, y, z, k, m, n = (matrix[axis][axis] for axis in range(6))
    return x, y, z, k, m, n
