"""Make the parts of a simulation. This is the only module that imports all of them and selects implementations.

Several parts exist in Python and in C (sim/native). The C is used where it was compiled, the Python otherwise. Both
return the same numbers to the last bit. Parts that few vehicles and worlds need are imported only when they are needed.
"""

from collections.abc import Callable, Iterable, Sequence
from random import Random
from typing import TYPE_CHECKING

from sim.dynamics import Dynamics, Integrator, State
from sim.environment.world import World
from sim.native import NativeDynamics, NativeErrorBank, NativeThrusterSet, choose, has_native
from sim.sensors.error import ErrorBank, ErrorModel
from sim.vehicle.thrusters.bank import ThrusterSet
from sim.vehicle.vehicle import Vehicle

if TYPE_CHECKING:
    from types import ModuleType

    from sim.environment.contact.impulses import ApplyImpulses, Separate
    from sim.environment.water import FluidMotion
    from sim.environment.waves import WaveField
    from sim.forces import Force
    from sim.native._native import FusedStep
    from sim.native._rays import Caster
    from sim.rays.geometry import Geometry
    from sim.sensors.samples import ImuSample
    from sim.tether import Flow, ReadBody, Tether, TetherKeys
    from sim.vehicle.accessories import Accessories
    from sim.vehicle.ballast import Release
    from sim.vehicle.collision_shape import HullShape
    from sim.vehicle.equipment import Equipment
    from sim.vehicle.failures import Failure


def make_dynamics(
    vehicle: Vehicle,
    density: float,
    gravity: float,
    integrator: Integrator = "verlet",
    forces: "Sequence[Force]" = (),
) -> Dynamics:
    """Return the equations of one vehicle in water of `density` kg/m³ under `gravity` m/s², in C if it is compiled.

    Raises ConfigError as `choose` does.
    """
    dynamics, _ = choose()
    return dynamics(vehicle, density, gravity, integrator, forces)


def make_thrusters(vehicle: Vehicle, dt: float, failures: "Iterable[Failure]" = (), seed: int = 0) -> ThrusterSet:
    """Return the thrusters of `vehicle`, stepped every `dt` s, with `failures` planned. Raises ConfigError.

    A vehicle with a battery or with rotor dynamics gets `Propulsion`, any other the simpler thruster set.
    """
    if vehicle.battery or any(t.dynamics for t in vehicle.thrusters):
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


def make_fused_step(
    state: State,
    dynamics: Dynamics,
    thrusters: ThrusterSet,
    command: "Callable[[tuple[int, ...]], None] | None",
    water: "FluidMotion | None",
    current: Sequence[float],
    dt_ns: int,
    shape: "HullShape",
    ventilation: Sequence[float],
) -> "FusedStep | None":
    """Return one C object that computes a whole step of `dt_ns`, or None if a part is not in C or a thruster may fail.

    `command` is called with new pulses for thrusters and equipment (None: for thrusters alone). `current` is the
    velocity of the water (NED, m/s) where `water` does not change it. `shape` is the hull for contacts, `ventilation`
    the numbers of the vehicle's Ventilation. Do not use the object any more after failures have been planned.
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
    return FusedStep(
        state, dynamics.kernel, thrusters.bank, command or thrusters.command, dt_ns, (shape.reach, *shape.extent),
        current, changing, wave_field, mass, ventilation,
    )  # fmt: skip


def make_imu(
    errors: ErrorBank, sample: "type[ImuSample]", position: Sequence[float], gravity: float
) -> "Callable[[int, State], ImuSample] | None":
    """Return the `sample` function of an IMU in C, or None if `errors` are not in C.

    It returns what sim.sensors.imu.Imu returns for a unit at `position` (m, body axes) that is aligned with the
    vehicle's axes, under `gravity` m/s².
    """
    if not isinstance(errors, NativeErrorBank):
        return None
    from sim.native._native import Imu

    return Imu(errors.errors, sample, position, gravity).sample


def make_error_bank(models: Iterable[ErrorModel], period: float, random: Random) -> ErrorBank:
    """Return the errors of one sensor that is sampled every `period` s, in C if it is compiled.

    Raises ConfigError as `choose` does.
    """
    return (NativeErrorBank if has_native() else ErrorBank)(models, period, random)


def make_impulses() -> "tuple[ApplyImpulses, Separate]":
    """Return the functions that solve the impulses and the position correction of a collision, in C if compiled.

    They are imported at the first contact. Raises ConfigError as `choose` does.
    """
    if has_native():
        from sim.native import impulses as native

        return native.apply_impulses, native.separate
    from sim.environment.contact import impulses

    return impulses.apply_impulses, impulses.separate


def make_caster(geometry: "Geometry") -> "Caster | None":
    """Return a ray caster in C, or None without C. Its `cast` is sim.rays.single.cast without the first argument.

    Raises ConfigError as `choose` does.
    """
    if not has_native("sim.native._rays"):
        return None
    from sim.native._rays import Caster

    _, _, solids, nodes, triangles = geometry
    terrain, depth = geometry.terrain, geometry.depth
    if terrain is None:
        return Caster((0, 0, 0.0, 0.0, 1.0, depth), b"", solids, nodes, triangles)
    north_min, east_min, _, rows, columns = terrain.grid
    ground = rows, columns, north_min, east_min, terrain.scale, terrain.outside
    return Caster(ground, terrain.depths, solids, nodes, triangles)


def load_picture() -> "ModuleType | None":
    """Return the C module sim.native._picture, which computes the light and the sensor of cameras; None without C.

    Raises ConfigError as `choose` does.
    """
    if not has_native("sim.native._picture"):
        return None
    from sim.native import _picture

    return _picture


def make_fluid_motion(vehicle: Vehicle, world: World, seed: int) -> "FluidMotion | None":
    """Return the motion of the water (waves, currents that change), or None if there is only a steady current."""
    if not (world.ocean and world.ocean.moves):
        return None
    from sim.environment.water import FluidMotion

    if not (world.ocean.waves and has_native()):
        return FluidMotion(vehicle, world, seed)
    from sim.native.waves import NativeSampledWaves

    return FluidMotion(vehicle, world, seed, NativeSampledWaves)


def make_surface_forces(vehicle: Vehicle, world: World, wave_field: "WaveField | None") -> "Sequence[Force]":
    """Return the forces of density layers and waves on the hull of `vehicle`: empty in calm, homogeneous water."""
    if not (world.ocean and (world.ocean.profile or world.ocean.waves)):
        return ()
    from sim.environment.stratification import surface_and_layers

    return surface_and_layers(vehicle, world, wave_field)


def make_tether(keys: "TetherKeys", world: World, dt: float, read_body: "ReadBody", flow: "Flow") -> "Tether":
    """Return the tether that `keys` describe, stepped every `dt` s.

    `read_body` returns the state and the inverse mass matrix of the vehicle, `flow` the water's velocity at a point.
    """
    from sim.tether import Tether

    return Tether(keys, world, dt, read_body, flow)


def make_accessories(vehicle: Vehicle) -> "Accessories | None":
    """Return the accessories of `vehicle`, or None if it has none."""
    if vehicle.accessories is None:
        return None
    from sim.vehicle.accessories import Accessories

    return Accessories(vehicle.accessories)


def make_equipment(vehicle: Vehicle, world: World, dt: float, releases: "Sequence[Release]") -> "Equipment | None":
    """Return the equipment of `vehicle`, stepped every `dt` s, or None if it has none.

    Raises ConfigError as Equipment does.
    """
    if not (vehicle.has_equipment or releases):
        return None
    from sim.vehicle.equipment import Equipment

    return Equipment(vehicle, world.density, world.gravity, dt, releases)
