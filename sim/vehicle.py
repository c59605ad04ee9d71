"""A vehicle as numbers: mass, shape, hydrodynamic coefficients and thrusters, read from TOML.

Every length is from the body origin along the body axes (x forward, y starboard, z down). Added mass and
damping are about that origin and written positive: the force is minus coefficient times velocity.
"""

from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from hil.errors import ConfigError
from hil.schema import Range, find_preset, parse
from hil.tables import read_table
from sim.matrices import Matrix, cross_matrix, is_positive_definite, is_symmetric, product, square, total, transpose
from sim.thruster_model import Point, Thruster, with_models

if TYPE_CHECKING:
    from sim.ballast import BuoyancyEngine, DropWeight
    from sim.battery import Battery
    from sim.body_lift import CrossFlow, Lift
    from sim.meshes import Mesh
    from sim.surfaces import Fin

__all__ = ["Point", "Thruster", "Vehicle", "displaced_volume", "load_vehicle", "mass_matrix", "rigid_mass_matrix"]

Size = Annotated[float, Range(0.01, 50.0, "m")]

MAX_CHANNELS = 16
# What of a vehicle's file is read by sim/equipment.py: most vehicles do without.
EQUIPMENT = ("fins", "lift", "cross_flow", "forward_speed_damping", "buoyancy_engine", "drop_weights")


class Vehicle(NamedTuple):
    """One vehicle. `source` says where its numbers come from.

    `volume` is the displaced volume in m³; with `neutrally_buoyant` it is trimmed to weigh nothing in
    whatever water it is in, as a crew does with ballast. `dimensions` are length, width and height.
    `inertia` is about the centre of gravity, kg m²: three diagonal numbers, or all nine row after row.
    `added_mass` (kg, kg m, kg m²), `linear_damping` (N s/m ...) and `quadratic_damping` (N s²/m² ...):
    six diagonal numbers for surge, sway, heave, roll, pitch, yaw, or all 36 row after row.
    `battery` feeds those thrusters whose curve knows its current (sim/battery.py); without one their supply holds.
    `meshes` are for pictures alone (sim/meshes.py).
    `fins` and all below are described in sim/equipment.py; mass, volume and inertia include the `drop_weights`.
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
    battery: "Battery | None" = None
    fins: "tuple[Fin, ...]" = ()
    lift: "Lift | None" = None
    cross_flow: "CrossFlow | None" = None
    forward_speed_damping: tuple[float, ...] = ()
    buoyancy_engine: "BuoyancyEngine | None" = None
    drop_weights: "tuple[DropWeight, ...]" = ()
    meshes: "tuple[Mesh, ...]" = ()

    @property
    def channels(self) -> tuple[str, ...]:
        """Whose pulse each output of the STM32 is: thrusters, then fins, buoyancy engine, drop weights."""
        engine = ("buoyancy engine",) if self.buoyancy_engine else ()
        thrusters, fins = [t.name for t in self.thrusters], [fin.name for fin in self.fins]
        return (*thrusters, *fins, *engine, *(weight.name for weight in self.drop_weights))

    @property
    def equipped(self) -> bool:
        """True if it has anything of sim/equipment.py."""
        return any(getattr(self, key) for key in EQUIPMENT)

    def problem(self) -> str | None:
        """What is wrong between the keys, if anything."""
        return self._shape_problem() or self._mass_problem() or self.channel_problem()

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

    def channel_problem(self) -> str | None:
        """What is wrong with the thrusters and all else that takes pulses, if anything."""
        if not 1 <= len(self.thrusters) <= MAX_CHANNELS:
            return f"a vehicle has 1 to {MAX_CHANNELS} thrusters, found {len(self.thrusters)}"
        names = self.channels
        if len(names) > MAX_CHANNELS:
            return f"an STM32 has {MAX_CHANNELS} outputs, found {len(names)} to drive: {', '.join(names)}"
        if len(set(names)) < len(names):
            what = "channels" if self.equipped else "thrusters"
            return f"two {what} have the same name: {', '.join(names)}"
        return None


def load_vehicle(name_or_path: str) -> tuple[Vehicle, dict[str, Any]]:
    """A preset of `sim/vehicles`, or a file ending in `.toml`: the vehicle, and its `[control]` table.

    The table belongs to whoever controls the vehicle and is handed on as it is, {} if absent. What all
    thrusters have in common may stand once, in `[every_thruster]`, and for fins in `[every_fin]`. Raises ConfigError.
    """
    path = find_preset("sim/vehicles", name_or_path)
    table = read_table(path)
    control = table.pop("control", {})
    battery, meshes = table.pop("battery", None), table.pop("meshes", [])
    rows = _with_common(table, "thrusters", "every_thruster")
    _with_common(table, "fins", "every_fin")
    equipment = {key: table.pop(key) for key in EQUIPMENT if key in table}
    models: list[dict[str, Any]] = [{key: row.pop(key) for key in ("curve", "dynamics") if key in row} for row in rows]
    vehicle = parse(table, Vehicle, path)
    if any(models):
        named = zip(vehicle.thrusters, models, strict=True)
        vehicle = vehicle._replace(thrusters=tuple([with_models(t, m, f"{path}: {t.name}") for t, m in named]))
    if battery is not None:
        from sim.battery import with_battery  # most vehicles do without

        vehicle = with_battery(vehicle, battery, path)
    if meshes:
        vehicle = vehicle._replace(meshes=_read_meshes(meshes, path))
    if equipment:
        from sim.equipment import with_equipment

        vehicle = with_equipment(vehicle, equipment, path)
    return vehicle, control


def _read_meshes(rows: Any, path: str) -> "tuple[Mesh, ...]":
    """The meshes of the file at `path`, their paths complete."""
    import os

    from sim.meshes import Mesh

    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise ConfigError(f"{path}: meshes: expected tables, each under [[meshes]]")
    meshes = [parse(row, Mesh, f"{path}: meshes[{i}]") for i, row in enumerate(rows)]
    return tuple([mesh._replace(file=os.path.join(os.path.dirname(path), mesh.file)) for mesh in meshes])


def _with_common(table: dict[str, Any], key: str, every: str) -> list[dict[str, Any]]:
    """The tables under `key`, each with what all have in common, under `every`; put back into `table`."""
    common, rows = table.pop(every, {}), table.get(key)
    if not (isinstance(rows, list) and isinstance(common, dict) and all(isinstance(row, dict) for row in rows)):
        return []  # parse says what is wrong
    table[key] = rows = [{**common, **row} for row in rows]
    return rows


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
