"""A vehicle as numbers: mass, shape, hydrodynamic coefficients and thrusters, read from TOML.

Every length is from the body origin along the body axes (x forward, y starboard, z down). Added mass and
damping are about that origin and written positive: the force is minus coefficient times velocity.
"""

from typing import Annotated, Any, NamedTuple

from hil.schema import Range, find_preset, parse
from hil.tables import read_table
from sim.matrices import Matrix, cross_matrix, is_positive_definite, is_symmetric, product, square, total, transpose

Metres = Annotated[float, Range(-50.0, 50.0, "m")]
Point = tuple[Metres, Metres, Metres]
Size = Annotated[float, Range(0.01, 50.0, "m")]
Pulse = Annotated[int, Range(800, 2200)]

MAX_THRUSTERS = 16


class Thruster(NamedTuple):
    """One thruster: where it sits, which way it pushes and how a pulse becomes thrust.

    `direction` is that of positive thrust, of any length; `unit_direction` has length 1. Thrust grows
    from the edge of the dead band (`dead_band_us` each side of neutral) to `max_forward` at
    `pwm_max_us` and `max_reverse` (both positive) at `pwm_min_us`, a share `linear_share` of it in
    proportion to the pulse and the rest with its square. `time_constant` is the lag of the thrust.
    Not modelled: loss of thrust with speed through the water, reaction torque, supply voltage.
    """

    name: str
    position: Point
    direction: tuple[float, float, float]
    max_forward: Annotated[float, Range(1e-3, 1e5, "N")]
    max_reverse: Annotated[float, Range(1e-3, 1e5, "N")]
    dead_band_us: Annotated[float, Range(0.0, 300.0)] = 0.0
    linear_share: Annotated[float, Range(0.0, 1.0)] = 0.0
    time_constant: Annotated[float, Range(0.0, 10.0, "s")] = 0.0
    pwm_neutral_us: Pulse = 1500
    pwm_min_us: Pulse = 1100
    pwm_max_us: Pulse = 1900

    @property
    def unit_direction(self) -> tuple[float, float, float]:
        """The direction of positive thrust with length 1."""
        x, y, z = self.direction
        length = (x * x + y * y + z * z) ** 0.5
        return x / length, y / length, z / length

    def problem(self) -> str | None:
        """What is wrong between the keys, if anything."""
        if not any(self.direction):
            return f"thruster {self.name!r}: direction is zero"
        low, high = self.pwm_min_us + self.dead_band_us, self.pwm_max_us - self.dead_band_us
        if not low < self.pwm_neutral_us < high:
            return f"thruster {self.name!r}: neutral and dead band leave no pulse to drive it both ways"
        return None


class Vehicle(NamedTuple):
    """One vehicle. `source` says where its numbers come from.

    `volume` is the displaced volume in m³; with `neutrally_buoyant` it is trimmed to weigh nothing in
    whatever water it is in, as a crew does with ballast. `dimensions` are length, width and height.
    `inertia` is about the centre of gravity, kg m²: three diagonal numbers, or all nine row after row.
    `added_mass` (kg, kg m, kg m²), `linear_damping` (N s/m ...) and `quadratic_damping` (N s²/m² ...):
    six diagonal numbers for surge, sway, heave, roll, pitch, yaw, or all 36 row after row.
    """

    name: str
    source: str
    mass: Annotated[float, Range(0.1, 1e6, "kg")]
    volume: Annotated[float, Range(1e-4, 1e3)]
    dimensions: tuple[Size, Size, Size]
    inertia: tuple[float, ...]
    center_of_buoyancy: Point
    added_mass: tuple[float, ...]
    linear_damping: tuple[float, ...]
    quadratic_damping: tuple[float, ...]
    thrusters: tuple[Thruster, ...]
    center_of_gravity: Point = (0.0, 0.0, 0.0)
    neutrally_buoyant: bool = False

    def problem(self) -> str | None:
        """What is wrong between the keys, if anything."""
        return self._shape_problem() or self._mass_problem() or self._thruster_problem()

    def _shape_problem(self) -> str | None:
        for key, size in (("inertia", 3), ("added_mass", 6), ("linear_damping", 6), ("quadratic_damping", 6)):
            count = len(getattr(self, key))
            if count not in (size, size * size):
                return f"{key} needs {size} numbers (diagonal) or {size * size} (full), found {count}"
        for key in ("linear_damping", "quadratic_damping"):
            matrix = square(getattr(self, key), 6)
            if any(matrix[i][i] < 0.0 for i in range(6)):
                return f"{key} is negative on its diagonal: write it positive, it always brakes"
        return None

    def _mass_problem(self) -> str | None:
        inertia, added = square(self.inertia, 3), square(self.added_mass, 6)
        if not is_symmetric(inertia) or not is_positive_definite(inertia):
            return "inertia is not symmetric and positive definite"
        if not is_symmetric(added):
            return "added_mass is not symmetric"
        if not is_positive_definite(total(rigid_mass_matrix(self), added)):
            return "mass plus added mass is not positive definite: write added mass positive"
        return None

    def _thruster_problem(self) -> str | None:
        names = [thruster.name for thruster in self.thrusters]
        if not 1 <= len(names) <= MAX_THRUSTERS:
            return f"a vehicle has 1 to {MAX_THRUSTERS} thrusters, found {len(names)}"
        if len(set(names)) < len(names):
            return f"two thrusters have the same name: {', '.join(names)}"
        return None


def load_vehicle(name_or_path: str) -> tuple[Vehicle, dict[str, Any]]:
    """A preset of `sim/vehicles`, or a file ending in `.toml`: the vehicle, and its `[control]` table.

    The table belongs to whoever controls the vehicle and is handed on as it is, {} if absent. What all
    thrusters have in common may stand once, in `[every_thruster]`. Raises ConfigError.
    """
    path = find_preset("sim/vehicles", name_or_path)
    table = read_table(path)
    control = table.pop("control", {})
    common = table.pop("every_thruster", {})
    if common and isinstance(table.get("thrusters"), list):
        table["thrusters"] = [{**common, **thruster} for thruster in table["thrusters"]]
    return parse(table, Vehicle, path), control


def rigid_mass_matrix(vehicle: Vehicle) -> Matrix:
    """M_RB about the body origin, 6x6 (Fossen 2021, eq. 3.44)."""
    mass = vehicle.mass
    lever = cross_matrix(vehicle.center_of_gravity)
    corner = [[mass * x for x in row] for row in lever]
    inertia = total(square(vehicle.inertia, 3), product(lever, lever), -mass)  # parallel axes
    upper = [a + b for a, b in zip(square([mass] * 3, 3), transpose(corner), strict=True)]
    return upper + [a + b for a, b in zip(corner, inertia, strict=True)]


def mass_matrix(vehicle: Vehicle) -> Matrix:
    """M = M_RB + M_A about the body origin, 6x6."""
    return total(rigid_mass_matrix(vehicle), square(vehicle.added_mass, 6))


def displaced_volume(vehicle: Vehicle, density: float) -> float:
    """The volume in m³ of the water it displaces; `density` in kg/m³ matters if the vehicle is trimmed."""
    return vehicle.mass / density if vehicle.neutrally_buoyant else vehicle.volume
