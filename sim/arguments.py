"""Check the arguments that a program passes to a simulation. Values from files are checked where they are read."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from hil.common.errors import ConfigError
from hil.common.schema import FINITE, parse
from sim import rotations
from sim.environment.world import World
from sim.vehicle.vehicle import Vehicle

if TYPE_CHECKING:
    from sim.dynamics import State
    from sim.forces import Force

MIN_DT_NS, MAX_DT_NS = 1_000, 100_000_000
MAX_POSITION = 1e6  # m from the origin; doubles there are 0.1 nm apart
MAX_HEADING = 1e6  # rad; beyond it, the sine and cosine of a heading lose too many digits


def require_parts(vehicle: Any, world: Any, sensors: Any) -> None:
    """Raise ConfigError for a vehicle, world or sensors of a wrong type. `sensors` may be None: the default ones."""
    if not isinstance(vehicle, Vehicle):
        raise ConfigError(f"vehicle = {vehicle!s:.40}: give a Vehicle, such as load_vehicle() returns")
    if not isinstance(world, World):
        raise ConfigError(f"world = {world!s:.40}: give a World, such as load_world() returns")
    if sensors is None:
        return
    if not hasattr(sensors, "items"):
        raise ConfigError(f"sensors = {sensors!s:.40}: give SensorSpec by name, such as fit() returns, or None")
    for name, spec in sensors.items():
        if not all(hasattr(spec, field) for field in ("sensor", "model", "mounting")):
            raise ConfigError(f"sensors: {name!s:.40} is {spec!s:.40}: give a SensorSpec, such as fit() returns")


def require_numbers(
    vehicle: Vehicle, world: World, seed: int, dt_ns: int, position: Sequence[float], heading: float
) -> None:
    """Raise ConfigError for numbers that a file cannot contain but a program can pass: nan, infinity, a step of 0."""
    if not isinstance(dt_ns, int) or not MIN_DT_NS <= dt_ns <= MAX_DT_NS:
        raise ConfigError(
            f"dt_ns = {dt_ns!s:.40}: a step takes whole ns, {MIN_DT_NS:,} to {MAX_DT_NS:,}, which is 100 ms"
        )
    if not hasattr(seed, "__index__") or isinstance(seed, bool) or seed < 0:
        raise ConfigError(f"seed = {seed!s:.40}: give a whole number from 0 on")
    _require_vector("position", position, MAX_POSITION, 3)
    _require_vector("heading", (heading,), MAX_HEADING, 1)
    _require_vector(f"current of {world.name}", world.current, FINITE.high, 3)
    _require_vector(f"density of {world.name}", (world.density,), FINITE.high, 1)
    _require_vector(f"gravity of {world.name}", (world.gravity,), FINITE.high, 1)
    problem = vehicle.validate()
    if problem:
        raise ConfigError(f"{vehicle.name}: {problem}")


def require_events(failures: Any, forces: Any = (), releases: Any = ()) -> None:
    """Raise ConfigError for failures, forces or releases of a wrong type or with impossible values."""
    if failures:
        from sim.vehicle.failures import Failure

        _require_records("failures", failures, Failure)
    if releases:
        from sim.vehicle.ballast import Release

        _require_records("releases", releases, Release)
    expected = "objects with begin() and wrench(), as sim.forces.Force"
    for number, force in enumerate(_require_list("forces", forces, expected)):
        if isinstance(force, type) or not all(callable(getattr(force, name, None)) for name in ("begin", "wrench")):
            raise ConfigError(
                f"forces[{number}] is {force!s:.40}: give an object with begin() and wrench(), as sim.forces.Force"
            )


def require_wrenches(forces: "Sequence[Force]", state: "State") -> None:
    """Raise ConfigError if a force does not return six numbers in this state."""
    for force in forces:
        wrench: Any = force.wrench(state.position, rotations.matrix(state.quaternion), state.nu)
        if not hasattr(wrench, "__len__") or len(wrench) != 6 or not all(hasattr(x, "__float__") for x in wrench):
            name = f"{type(force).__module__}:{type(force).__qualname__}"
            raise ConfigError(f"the force {name} returned {wrench!s:.60}: a wrench is six numbers, X Y Z K M N")


def _require_records(key: str, value: Any, record_type: type[Any]) -> None:
    for number, record in enumerate(_require_list(key, value, f"{record_type.__name__} records")):
        if not isinstance(record, record_type):
            raise ConfigError(f"{key}[{number}] is {record!s:.40}: give a {record_type.__name__}")
        parse(record._asdict(), record_type, f"{key}[{number}]")


def _require_list(key: str, value: Any, expected: str) -> Sequence[Any]:
    """Return `value` if it is a list or a tuple. A NamedTuple is one record, not a list, and is refused.

    Raises ConfigError, which names the `expected` items.
    """
    if not isinstance(value, (list, tuple)) or hasattr(value, "_asdict"):
        raise ConfigError(f"{key} = {value!s:.40}: give a list of {expected}")
    return value


def _require_vector(key: str, numbers: Sequence[float], limit: float, count: int) -> None:
    if not hasattr(numbers, "__len__") or len(numbers) != count:
        given = len(numbers) if hasattr(numbers, "__len__") else f"{numbers!s:.40}"
        raise ConfigError(f"{key}: {given} numbers: give three, north, east and down")
    for number in numbers:
        if not hasattr(number, "__float__") or not abs(number) <= limit:
            allowed = "finite ones" if limit == FINITE.high else f"finite ones, to {limit:,.0f}"
            raise ConfigError(f"{key}: {number!s:.40} is no number to start from: give {allowed}")
