"""Vehicle records read from TOML: mass, shape, hydrodynamic coefficients and thrusters.

Every length is from the body origin along the body axes (x forward, y starboard, z down). Added mass and
damping are about that origin and written positive: the force is minus coefficient times velocity.
"""

from collections.abc import Sequence
from math import isfinite
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from hil.common.errors import ConfigError
from hil.common.schema import Range, Reader, find_preset, parse, parse_rows, reader_of
from hil.common.tables import read_table
from sim.matrices import (
    Entry,
    Matrix,
    cross_matrix,
    is_positive_definite,
    is_positive_semidefinite,
    is_symmetric,
    product,
    square,
    total,
    transpose,
)
from sim.vehicle.thrusters.model import Point, Thruster

if TYPE_CHECKING:
    from sim.vehicle.accessories import AccessoryKeys
    from sim.vehicle.ballast import BuoyancyEngine, DropWeight
    from sim.vehicle.battery import Battery
    from sim.vehicle.body_lift import CrossFlow, FadingDamping, Lift
    from sim.vehicle.collision_shape import Collision
    from sim.vehicle.fins import Fin
    from sim.vehicle.hull_form import HullForm, Windage
    from sim.vehicle.meshes import Mesh

__all__ = [
    "Point", "Thruster", "Vehicle", "displaced_volume", "load_vehicle", "mass_matrix", "parse_vehicle",
    "rigid_mass_matrix", "validate_drop_weights", "without_weight",
]  # fmt: skip

Size = Annotated[float, Range(0.01, 50.0, "m")]
Share = Annotated[float, Range(0.0, 1.0)]

MAX_CHANNELS = 16
# Size of each matrix. A file gives either its diagonal or all of its numbers.
SIZES = {"inertia": 3, "added_mass": 6, "linear_damping": 6, "quadratic_damping": 6, "forward_speed_damping": 6}
DAMPING = ("linear_damping", "quadratic_damping", "forward_speed_damping")
TILT_NEVER = 3.2  # rad: more than a vehicle can tilt
POINTS = ("dimensions", "center_of_gravity", "center_of_buoyancy", "munk_share")
# The keys of a vehicle's file for equipment (sim/vehicle/equipment.py). Most vehicles have none of them.
EQUIPMENT = (
    "fins", "lift", "cross_flow", "forward_speed_damping", "fading_damping", "buoyancy_engine", "drop_weights",
)  # fmt: skip
COMMON = {"thrusters": "every_thruster", "fins": "every_fin"}  # tables -> table of the keys that they share
OTHER_KEYS = ("control", *COMMON.values())
MODELS = {"curve": reader_of("sim.vehicle.thrusters.curves:read_curve")}
# Readers of keys that few vehicles have: their modules are imported only for these.
READERS: dict[str, Reader] = {
    "thrusters": lambda rows, where: parse_rows(rows, Thruster, where, MODELS),
    "battery": reader_of("sim.vehicle.battery:Battery"),
    "fins": reader_of("sim.vehicle.fins:Fin", many=True),
    "lift": reader_of("sim.vehicle.body_lift:Lift"),
    "cross_flow": reader_of("sim.vehicle.body_lift:CrossFlow"),
    "fading_damping": reader_of("sim.vehicle.body_lift:FadingDamping"),
    "buoyancy_engine": reader_of("sim.vehicle.ballast:BuoyancyEngine"),
    "drop_weights": reader_of("sim.vehicle.ballast:DropWeight", many=True),
    "meshes": reader_of("sim.vehicle.meshes:Mesh", many=True),
    "collision": reader_of("sim.vehicle.collision_shape:Collision"),
    "hull": reader_of("sim.vehicle.hull_form:HullForm"),
    "windage": reader_of("sim.vehicle.hull_form:Windage"),
    "accessories": reader_of("sim.vehicle.accessories:AccessoryKeys"),
}
DENSITIES = (50.0, 20_000.0)  # kg/m³: outside of these, mass or volume is in another unit


class Vehicle(NamedTuple):
    """One vehicle. `source` names where its numbers come from.

    `volume` is the displaced volume in m³. With `neutrally_buoyant` it is adjusted so that the vehicle weighs nothing
    in the water of its world, as a crew does with ballast. `dimensions` are length, width and height.
    `inertia` is about the centre of gravity, kg m²: three diagonal numbers, or all nine row after row.
    `added_mass` (kg, kg m, kg m²), `linear_damping` (N s/m ...) and `quadratic_damping` (N s²/m² ...):
    six diagonal numbers for surge, sway, heave, roll, pitch, yaw, or all 36 row after row.
    `munk_share` is the share of the Munk moment that remains about roll, pitch and yaw (sim/dynamics.py): 1 in ideal
    fluid, 0 for an open frame, where the flow separates everywhere.
    `attitude_limit_speed` is the highest surge at which the vehicle's controller keeps its attitude; a scenario that
    commands more causes a warning. Leave it out for a vehicle that stays level up to its top speed.
    `battery` supplies those thrusters whose curve has a current (sim/vehicle/battery.py); without a battery the supply
    voltage is constant.
    `meshes` are used in pictures only (sim/vehicle/meshes.py). `collision` is the shape for contacts, with friction and
    restitution (sim/vehicle/collision_shape.py), `hull` the form that floats (sim/vehicle/hull_form.py), `windage` what
    the wind can reach; each is a box of `dimensions`, or follows from them, if left out.
    The vehicle counts as capsized if it is tilted from the vertical by more than `capsize_tilt` (rad, pi: never).
    `accessories` are lights, camera tilt and gripper (sim/vehicle/accessories.py).
    `fins` and the keys of equipment are described in sim/vehicle/equipment.py; mass, volume and inertia include the
    `drop_weights`.
    """

    name: str
    source: str
    mass: Annotated[float, Range(0.1, 1e6, "kg")]
    volume: Annotated[float, Range(1e-4, 1e3, "m³")]
    dimensions: tuple[Size, Size, Size]
    inertia: tuple[Entry, ...]
    center_of_buoyancy: Point
    added_mass: tuple[Entry, ...]
    linear_damping: tuple[Entry, ...]
    quadratic_damping: tuple[Entry, ...]
    thrusters: tuple[Thruster, ...]
    center_of_gravity: Point = (0.0, 0.0, 0.0)
    neutrally_buoyant: bool = False
    capsize_tilt: Annotated[float, Range(0.05, TILT_NEVER, "rad")] = 1.0472  # 60 deg
    munk_share: tuple[Share, Share, Share] = (1.0, 1.0, 1.0)
    attitude_limit_speed: Annotated[float, Range(0.01, 20.0, "m/s")] | None = None
    battery: "Battery | None" = None
    fins: "tuple[Fin, ...]" = ()
    lift: "Lift | None" = None
    cross_flow: "CrossFlow | None" = None
    forward_speed_damping: tuple[Entry, ...] = ()
    fading_damping: "FadingDamping | None" = None
    buoyancy_engine: "BuoyancyEngine | None" = None
    drop_weights: "tuple[DropWeight, ...]" = ()
    meshes: "tuple[Mesh, ...]" = ()
    collision: "Collision | None" = None
    hull: "HullForm | None" = None
    windage: "Windage | None" = None
    accessories: "AccessoryKeys | None" = None

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the STM32's outputs: thrusters, fins, azimuths of thrusters, buoyancy engine, drop weights."""
        engine = ("buoyancy engine",) if self.buoyancy_engine else ()
        thrusters, fins = [t.name for t in self.thrusters], [fin.name for fin in self.fins]
        return (*thrusters, *fins, *self.azimuths, *engine, *(weight.name for weight in self.drop_weights))

    @property
    def azimuths(self) -> list[str]:
        """Names of the servos of azimuth thrusters."""
        return [f"{thruster.name} azimuth" for thruster in self.thrusters if thruster.azimuth]

    @property
    def has_equipment(self) -> bool:
        """True if it has any equipment of sim/vehicle/equipment.py."""
        return any(getattr(self, key) for key in EQUIPMENT) or bool(self.azimuths)

    def validate(self) -> str | None:
        """Return what is wrong with the combination of the keys, a line for each problem, or None."""
        others = (self._validate_masses, self._validate_damping, self._validate_pwm)
        return self._validate_numbers() or "\n".join(filter(None, (check() for check in others))) or None

    def _validate_numbers(self) -> str | None:
        for key in ("mass", "volume", *POINTS, *SIZES):
            value = getattr(self, key)
            numbers = value if isinstance(value, tuple) else (value,)
            bad = next((x for x in numbers if not isfinite(x)), None)
            if bad is not None:
                return f"{key}: {bad:g} is not finite: write a finite number"
        if min(self.mass, self.volume, *self.dimensions) <= 0.0:
            return "mass, volume and dimensions must be above 0"
        density = self.mass / self.volume
        if not DENSITIES[0] <= density <= DENSITIES[1]:
            return (
                f"volume: {self.volume:g} m³ with a mass of {self.mass:g} kg makes {density:.3g} kg/m³, which is no "
                "vehicle: write the volume in cubic metres (11 litres are 0.011) and the mass in kg"
            )
        if not all(0.0 <= share <= 1.0 for share in self.munk_share):
            return "munk_share: each share is from 0 to 1"
        if not 0.0 < self.capsize_tilt <= TILT_NEVER:
            return f"capsize_tilt: {self.capsize_tilt:g} rad is outside 0 to {TILT_NEVER:g}"
        for key, size in SIZES.items():
            count = len(getattr(self, key))
            if count not in (size, size * size) and (count or key not in EQUIPMENT):
                return f"{key} needs {size} numbers (diagonal) or {size * size} (full), found {count}"
        return None

    def _validate_damping(self) -> str | None:
        """Return an error for damping that adds energy, or None. Of quadratic damping only the diagonal is checked."""
        for key in DAMPING:
            matrix = square(getattr(self, key) or (0.0,) * 6, 6)
            if any(matrix[i][i] < 0.0 for i in range(6)):
                return f"{key} is negative on its diagonal: write it positive, it always brakes"
            if key != "quadratic_damping" and not is_positive_semidefinite(matrix):
                return (
                    f"{key} makes energy in some motions: its symmetric part is not positive semidefinite; "
                    "make what couples two axes smaller than the root of the product of their own two numbers"
                )
        return None

    def _validate_masses(self) -> str | None:
        inertia, added = square(self.inertia, 3), square(self.added_mass, 6)
        if not is_symmetric(inertia) or not is_positive_definite(inertia):
            return "inertia is not symmetric and positive definite"
        half_trace = 0.5 * sum(inertia[i][i] for i in range(3))
        if not is_positive_semidefinite(total(square([half_trace] * 3, 3), inertia, -1.0)):
            return "inertia is that of no body: each principal moment is at most the sum of the other two"
        if not is_symmetric(added):
            return "added_mass is not symmetric"
        if not is_positive_definite(total(rigid_mass_matrix(self), added)):
            return "mass plus added mass is not positive definite: write added mass positive"
        return None

    def _validate_pwm(self) -> str | None:
        """Return what is wrong with the thrusters and everything else that takes pulses, or None."""
        if not 1 <= len(self.thrusters) <= MAX_CHANNELS:
            return f"a vehicle has 1 to {MAX_CHANNELS} thrusters, found {len(self.thrusters)}"
        names = self.channels
        if len(names) > MAX_CHANNELS:
            return f"an STM32 has {MAX_CHANNELS} outputs, found {len(names)} to drive: {', '.join(names)}"
        if len(set(names)) < len(names):
            outputs = "channels" if self.has_equipment else "thrusters"
            return f"two {outputs} have the same name: {', '.join(names)}"
        return None


def load_vehicle(name_or_path: str) -> tuple[Vehicle, dict[str, Any]]:
    """Return the vehicle of a preset of `sim/vehicles` or of a `.toml` file, and its `[control]` table.

    The table is for the controller; it is returned unchanged, {} if absent. Keys that all thrusters share may be given
    once, in `[every_thruster]`, and those of fins in `[every_fin]`. Raises ConfigError.
    """
    path = find_preset("sim/vehicles", name_or_path)
    table = read_table(path)
    control = table.pop("control", {})
    shared = {key: _share(table, key, table.pop(every, {})) for key, every in COMMON.items()}
    try:
        return parse_vehicle(table, path), control
    except ConfigError as error:
        raise ConfigError(*dict.fromkeys([_name_common(problem, path, shared) for problem in error.args])) from None


def parse_vehicle(table: dict[str, Any], path: str) -> Vehicle:
    """Return the vehicle of a file's `table`. Raises ConfigError with all problems; `path` begins each."""
    vehicle = parse(table, Vehicle, path, READERS, OTHER_KEYS)
    problems = [validate_drop_weights(vehicle), _validate_battery(vehicle)]
    if any(problems):
        raise ConfigError(*[f"{path}: {problem}" for problem in problems if problem])
    if not vehicle.meshes and not (vehicle.hull and vehicle.hull.file):
        return vehicle
    import os  # most vehicles have no files

    folder = os.path.dirname(path)
    hull = vehicle.hull and vehicle.hull._replace(file=vehicle.hull.file and os.path.join(folder, vehicle.hull.file))
    meshes = tuple([mesh._replace(file=os.path.join(folder, mesh.file)) for mesh in vehicle.meshes])
    return vehicle._replace(meshes=meshes, hull=hull)


def _validate_battery(vehicle: Vehicle) -> str | None:
    """Return why nothing draws from the battery of `vehicle`, or None."""
    if vehicle.battery is None:
        return None
    from sim.vehicle.thrusters.curves import T200

    if any(isinstance(thruster.curve, T200) for thruster in vehicle.thrusters):
        return None
    return 'battery: no thruster draws from it: only curve = { kind = "t200" } knows its current'


def _share(table: dict[str, Any], key: str, common: Any) -> set[str]:
    """Add the keys of the table `common` to each table under `key`; return those that no table has of its own."""
    rows = table.get(key)
    if not (isinstance(rows, list) and isinstance(common, dict) and all(isinstance(row, dict) for row in rows)):
        return set()  # `parse` raises the error
    table[key] = [{**common, **row} for row in rows]
    return set(common).difference(*rows)


def _name_common(problem: str, path: str, shared: dict[str, set[str]]) -> str:
    """Return the problem of a key that all rows share, named by its common table: one mistake is reported once."""
    for key, names in shared.items():
        start, _, rest = problem.removeprefix(f"{path}: ").partition(": ")
        if start.startswith(f"{key}[") and rest.removeprefix("no key '").partition(":")[0].partition("'")[0] in names:
            return f"{path}: {COMMON[key]}: {rest}"
    return problem


def rigid_mass_matrix(vehicle: Vehicle) -> Matrix:
    """Return M_RB about the body origin, 6x6 (Fossen 2021, eq. 3.44)."""
    mass = vehicle.mass
    lever = cross_matrix(vehicle.center_of_gravity)
    corner = [[mass * x for x in row] for row in lever]
    inertia = total(square(vehicle.inertia, 3), product(lever, lever), -mass)  # parallel axes
    upper = [a + b for a, b in zip(square([mass] * 3, 3), transpose(corner), strict=True)]
    return upper + [a + b for a, b in zip(corner, inertia, strict=True)]


def mass_matrix(vehicle: Vehicle) -> Matrix:
    """Return M = M_RB + M_A about the body origin, 6x6."""
    return total(rigid_mass_matrix(vehicle), square(vehicle.added_mass, 6))


def displaced_volume(vehicle: Vehicle, density: float) -> float:
    """Return the displaced volume in m³; `density` (kg/m³) is used only for a neutrally buoyant vehicle."""
    return vehicle.mass / density if vehicle.neutrally_buoyant else vehicle.volume


def without_weight(vehicle: Vehicle, weight: "DropWeight", density: float) -> Vehicle:
    """Return `vehicle` after it has dropped `weight`, a point mass, in water of `density` kg/m³.

    Mass, volume, both centres and the inertia about the new centre of gravity change; the added mass does not. A
    vehicle that was neutrally buoyant no longer is.
    """
    volume = displaced_volume(vehicle, density)
    mass, new_volume = vehicle.mass - weight.mass, volume - weight.volume
    centre = _centre_without(vehicle.center_of_gravity, vehicle.mass, weight.position, weight.mass)
    about_origin = total(square(vehicle.inertia, 3), _steiner(vehicle.center_of_gravity, vehicle.mass))
    about_origin = total(about_origin, _steiner(weight.position, weight.mass), -1.0)
    inertia = total(about_origin, _steiner(centre, mass), -1.0)
    return vehicle._replace(
        mass=mass,
        volume=new_volume,
        neutrally_buoyant=False,
        center_of_gravity=centre,
        center_of_buoyancy=_centre_without(vehicle.center_of_buoyancy, volume, weight.position, weight.volume),
        inertia=tuple([x for row in inertia for x in row]),
    )


def validate_drop_weights(vehicle: Vehicle) -> str | None:
    """Return what would be wrong with `vehicle` after it has dropped its weights, or None."""
    for weight in vehicle.drop_weights:
        if weight.mass >= vehicle.mass or weight.volume >= vehicle.volume:
            return f"drop weight {weight.name!r} is more than the vehicle, which it is a part of"
        vehicle = without_weight(vehicle, weight, 1000.0)
        if not is_positive_definite(square(vehicle.inertia, 3)):
            return f"drop weight {weight.name!r} leaves an inertia that is not positive definite"
    return None


def _centre_without(centre: Sequence[float], mass: float, position: Sequence[float], removed_mass: float) -> Point:
    """Return the centre of a body of size `mass` after a point of size `removed_mass` at `position` was removed."""
    x, y, z = [(mass * a - removed_mass * b) / (mass - removed_mass) for a, b in zip(centre, position, strict=True)]
    return x, y, z


def _steiner(position: Sequence[float], mass: float) -> Matrix:
    """Return the inertia (kg m²) about the origin of a point mass (kg) at `position` (m)."""
    lever = cross_matrix(position)
    return [[-mass * x for x in row] for row in product(lever, lever)]
