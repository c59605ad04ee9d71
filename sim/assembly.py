"""Make the parts of a simulation. This is the only module that imports all of them.

Several parts exist in Python and in C (sim/native). The C is used where it was compiled, the Python otherwise. Both
return the same numbers to the last bit. Parts that few vehicles and worlds need are imported only when they are needed.
"""

from collections.abc import Callable, Iterable, Sequence
from importlib import import_module
from typing import TYPE_CHECKING, NamedTuple

from sim.dynamics import Dynamics, State
from sim.environment.collision import Contact
from sim.environment.world import World
from sim.native import NativeDynamics, NativeThrusterSet, choose, has_native
from sim.vehicle.thrusters.bank import ThrusterSet
from sim.vehicle.vehicle import Vehicle
from sim.vehicle.ventilation import Ventilation

if TYPE_CHECKING:
    from sim.environment.water import FluidMotion
    from sim.environment.waves import WaveField
    from sim.forces import Force
    from sim.native._native import FusedStep
    from sim.tether import Flow, ReadBody, Tether, TetherKeys
    from sim.vehicle.accessories import Accessories
    from sim.vehicle.ballast import Release
    from sim.vehicle.equipment import Equipment
    from sim.vehicle.failures import Failure


class Parts(NamedTuple):
    """The parts of a simulation that move its vehicle, before the first step; None for those that it does not need.

    `forces` are those of equipment, user and tether; `fused` does a whole step in C.
    """

    state: State
    dynamics: Dynamics
    forces: "Sequence[Force]"
    thrusters: ThrusterSet
    contact: Contact
    ventilation: Ventilation
    water: "FluidMotion | None"
    accessories: "Accessories | None"
    equipment: "Equipment | None"
    tether: "Tether | None"
    fused: "FusedStep | None"


def assemble(
    vehicle: Vehicle,
    world: World,
    seed: int,
    dt_ns: int,
    pose: tuple[Sequence[float], Sequence[float]],
    failures: "Sequence[Failure]",
    own_forces: "Sequence[Force]",
    releases: "Sequence[Release]",
    tether_keys: "TetherKeys | None",
    command: "Callable[[tuple[int, ...]], None]",
    read_body: "ReadBody",
    flow: "Flow",
) -> Parts:
    """Return the parts of the simulation of `vehicle` at `pose` (NED, m; body to world), stepped every `dt_ns`.

    `command` is called with new pulses for thrusters and equipment. `read_body` returns the present state and inverse
    mass matrix, `flow` the water's velocity at a point. Raises ConfigError.
    """
    dt = dt_ns * 1e-9
    state = make_state(*pose)
    water = _make_water(vehicle, world, seed) if world.ocean and world.ocean.moves else None
    accessories = equipment = tether = None
    if vehicle.accessories is not None:
        from sim.vehicle.accessories import Accessories

        accessories = Accessories(vehicle.accessories)
    if vehicle.has_equipment or releases:
        from sim.vehicle.equipment import Equipment

        equipment = Equipment(vehicle, world.density, world.gravity, dt, releases)
    if tether_keys is not None:
        from sim.tether import Tether

        tether = Tether(tether_keys, world, dt, read_body, flow)
    forces = [*(equipment.forces if equipment else ()), *own_forces, *([tether] if tether else ())]
    wave_field = water.wave_field if water else None
    dynamics = make_hull_dynamics(vehicle, world, forces, wave_field, seed)
    thrusters = make_thrusters(vehicle, dt, failures, seed)
    if equipment and equipment.azimuths:
        equipment.azimuths.read_thrusts = lambda: thrusters.thrusts
    impulses = import_module("sim.native.impulses" if has_native() else "sim.environment.contact.impulses")
    solvers = impulses.apply_impulses, impulses.separate
    contact = Contact(vehicle, world, dynamics.inverse_mass, dt, solvers)
    ventilation = Ventilation(vehicle, wave_field)
    fused = None
    if equipment is None or not equipment.is_timed:
        command = thrusters.command if equipment is None else command
        numbers = dt_ns, (contact.shape.reach, *contact.shape.extent), world.current, ventilation.numbers()
        fused = _make_fused_step(state, dynamics, thrusters, command, water, *numbers)
    others = water, accessories, equipment, tether, fused
    return Parts(state, dynamics, forces, thrusters, contact, ventilation, *others)


def make_hull_dynamics(
    vehicle: Vehicle,
    world: World,
    forces: "Sequence[Force]",
    wave_field: "WaveField | None",
    seed: int,
) -> Dynamics:
    """Return the equations of `vehicle` in `world` with `forces` and those of density layers, waves and wind."""
    if world.ocean and (world.ocean.profile or world.ocean.waves):
        from sim.environment.stratification import surface_and_layers

        forces = [*forces, *surface_and_layers(vehicle, world, wave_field)]
    if world.wind:
        from sim.environment.wind import WindForce

        forces = [*forces, WindForce(vehicle, world.wind, wave_field, seed)]
    return make_dynamics(vehicle, world.density, world.gravity, forces)


def _make_water(vehicle: Vehicle, world: World, seed: int) -> "FluidMotion":
    """Return the motion of the water in waves and in currents that change."""
    from sim.environment.water import FluidMotion

    if not (world.ocean and world.ocean.waves and has_native()):
        return FluidMotion(vehicle, world, seed)
    from sim.native.waves import NativeSampledWaves

    return FluidMotion(vehicle, world, seed, NativeSampledWaves)


def _make_fused_step(
    state: State,
    dynamics: Dynamics,
    thrusters: ThrusterSet,
    command: "Callable[[tuple[int, ...]], None]",
    water: "FluidMotion | None",
    dt_ns: int,
    extent: Sequence[float],
    current: Sequence[float],
    ventilation: Sequence[float],
) -> "FusedStep | None":
    """Return one C object that computes a whole step, or None if a part is not in C or a thruster may fail.

    Do not use the object any more after failures have been planned.
    """
    if not (isinstance(dynamics, NativeDynamics) and isinstance(thrusters, NativeThrusterSet)):
        return None
    if not (dynamics.has_native_forces and thrusters.is_native):
        return None
    from sim.native._native import FusedStep

    changing, wave_field, mass = None, None, None
    if water is not None:
        changing = None if water.is_steady else water.current
        wave_field, mass = getattr(water.wave_field, "twin", None), water.wave_inertia
    parts = state, dynamics.kernel, thrusters.bank, command
    return FusedStep(*parts, dt_ns, extent, current, changing, wave_field, mass, ventilation)


def make_dynamics(
    vehicle: Vehicle,
    density: float,
    gravity: float,
    forces: "Sequence[Force]" = (),
) -> Dynamics:
    """Return the equations of one vehicle in water of `density` kg/m³ under `gravity` m/s², in C if it is compiled.

    Raises ConfigError as `choose` does.
    """
    dynamics, _ = choose()
    return dynamics(vehicle, density, gravity, forces)


def make_thrusters(vehicle: Vehicle, dt: float, failures: "Iterable[Failure]" = (), seed: int = 0) -> ThrusterSet:
    """Return the thrusters of `vehicle`, stepped every `dt` s, with `failures` planned. Raises ConfigError.

    A vehicle with a battery gets `Propulsion`, any other the simpler thruster set.
    """
    if vehicle.battery:
        from sim.vehicle.thrusters.propulsion import Propulsion

        thrusters: ThrusterSet = Propulsion(vehicle, dt, seed)
    else:
        thrusters = make_thruster_set(vehicle, dt, seed)
    planned = tuple(failures)
    if planned:
        thrusters.fail(planned)
    return thrusters


def make_thruster_set(vehicle: Vehicle, dt: float, seed: int = 0) -> ThrusterSet:
    """Return thrusters with first-order lags and no battery, in C if it is compiled.

    Raises ConfigError as `choose` does.
    """
    return (NativeThrusterSet if has_native() else ThrusterSet)(vehicle, dt, seed)


def make_state(position: Sequence[float], quaternion: Sequence[float]) -> State:
    """Return the state of a vehicle at rest at `position` (NED, m) and `quaternion` (w x y z, body to world).

    The state in C returns tuples, which are copies: assign a whole tuple to change it.
    """
    if not has_native():
        return State(position, quaternion)
    from sim.native._native import State as NativeState

    return NativeState(position, quaternion)
