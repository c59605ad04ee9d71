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
FARTHEST = 1e6  # m from the origin; doubles there are 0.1 nm apart
MOST_TURNED = 1e6  # rad; beyond it, the sine and cosine of a heading lose too many digits


def require_parts(vehicle: Any, world: Any, sensors: Any) -> None:
    """Raise ConfigError for a vehicle, a world or sensors (None: the usual ones) that are of another type."""
    if not isinstance(vehicle, Vehicle):
        raise ConfigError(f"vehicle = {vehicle!s:.40}: give a Vehicle, such as load_vehicle() returns")
    if not isinstance(world, World):
        raise ConfigError(f"world = {world!s:.40}: give a World, such as load_world() returns")
    if sensors is None:
        return
    if not hasattr(sensors, "items"):
        raise ConfigError(f"sensors = {sensors!s:.40}: give SensorSpec by name, such as fit() returns, or None")
    for name, fitted in sensors.items():
        if not all(hasattr(fitted, part) for part in ("sensor", "model", "mounting")):
            raise ConfigError(f"sensors: {name!s:.40} is {fitted!s:.40}: give a SensorSpec, such as fit() returns")


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
    _require_vector("position", position, FARTHEST, 3)
    _require_vector("heading", (heading,), MOST_TURNED, 1)
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
    for number, force in enumerate(_listed("forces", forces, "objects with begin() and wrench(), as sim.forces.Force")):
        if isinstance(force, type) or not all(callable(getattr(force, name, None)) for name in ("begin", "wrench")):
            raise ConfigError(
                f"forces[{number}] is {force!s:.40}: give an object with begin() and wrench(), as sim.forces.Force"
            )


def require_wrenches(forces: "Sequence[Force]", state: "State") -> None:
    """Raise ConfigError for a force that does not return six numbers in this state."""
    for force in forces:
        wrench: Any = force.wrench(state.position, rotations.matrix(state.quaternion), state.nu)
        if not hasattr(wrench, "__len__") or len(wrench) != 6 or not all(hasattr(x, "__float__") for x in wrench):
            name = f"{type(force).__module__}:{type(force).__qualname__}"
            raise ConfigError(f"the force {name} returned {wrench!s:.60}: a wrench is six numbers, X Y Z K M N")


def _require_records(key: str, given: Any, record: type[Any]) -> None:
    for number, each in enumerate(_listed(key, given, f"{record.__name__} records")):
        if not isinstance(each, record):
            raise ConfigError(f"{key}[{number}] is {each!s:.40}: give a {record.__name__}")
        parse(each._asdict(), record, f"{key}[{number}]")


def _listed(key: str, given: Any, what: str) -> Sequence[Any]:
    """Return `given` if it is a list or a tuple. One of our records is a tuple too, but it is not a list of records."""
    if not isinstance(given, (list, tuple)) or hasattr(given, "_asdict"):
        raise ConfigError(f"{key} = {given!s:.40}: give a list of {what}")
    return given


def _require_vector(key: str, numbers: Sequence[float], most: float, count: int) -> None:
    if not hasattr(numbers, "__len__") or len(numbers) != count:
        given = len(numbers) if hasattr(numbers, "__len__") else f"{numbers!s:.40}"
        raise ConfigError(f"{key}: {given} numbers: give three, north, east and down")
    for number in numbers:
        if not hasattr(number, "__float__") or not abs(number) <= most:
            words = "finite ones" if most == FINITE.high else f"finite ones, to {most:,.0f}"
            raise ConfigError(f"{key}: {number!s:.40} is no number to start from: give {words}")
