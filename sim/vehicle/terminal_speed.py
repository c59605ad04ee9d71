"""Compute the steady speed at which drag equals the thrust that is available."""

from math import inf, sqrt
from typing import NamedTuple

from sim.matrices import Matrix, square
from sim.vehicle.thrusters.bank import wrench_matrix
from sim.vehicle.thrusters.curves import Advance
from sim.vehicle.vehicle import Vehicle, displaced_volume

AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")
_ROLL, _PITCH = 3, 4
# An axis counts as driven if the wrench on other axes is at most this share of the requested wrench.
_MAX_COUPLING = 0.01


class AxisCapability(NamedTuple):
    """Capability of the thrusters along one axis; each pair is for the positive, then for the negative direction.

    `force` is in N (surge, sway, heave) or N m, `speed` in m/s or rad/s, both signed along the FRD body
    axes. Both forces are 0 where the thrusters cannot push along this axis without pushing elsewhere.
    """

    axis: str
    force: tuple[float, float]
    speed: tuple[float, float]

    @property
    def driven(self) -> bool:
        """True if the thrusters can push along this axis alone."""
        return self.force[0] > 0.0


def terminal_speed(force: float, linear: float, quadratic: float) -> float:
    """Return the speed v in m/s (rad/s) with linear v + quadratic v |v| = `force` N (N m); it has the force's sign.

    `linear` in N s/m (N m s), `quadratic` in N s²/m² (N m s²), neither negative; infinite if both are 0.
    """
    size = abs(force)
    if size == 0.0:
        return 0.0
    divisor = linear + sqrt(linear * linear + 4.0 * quadratic * size)  # the root that stays exact for quadratic 0
    speed = 2.0 * size / divisor if divisor else inf
    return speed if force > 0.0 else -speed


def axis_capabilities(
    vehicle: Vehicle, inverse: Matrix, density: float = 1000.0, gravity: float = 9.80665
) -> tuple[AxisCapability, ...]:
    """Return the greatest force and speed of `vehicle` along each of the six axes, with thrusters within their limits.

    `inverse` is the thrust allocation: n rows of 6, the thrusts (N) for 1 N or 1 N m along each axis, as
    `hil.autonomy.control.allocation.pseudo_inverse` returns for the vehicle's wrench matrix. The weight of the vehicle
    in water of `density` kg/m³ under `gravity` m/s² adds to the force down and reduces the force up. Propellers lose
    thrust with speed if their curve has a loss; hull and fins have the drag of sim/vehicle/equipment.py. Not
    considered: damping that couples axes or decreases with the speed, lift of fins, and, for roll and pitch, the
    righting moment of weight and buoyancy, which prevents most vehicles from turning over at all.
    """
    matrix = wrench_matrix(vehicle)
    linear, quadratic = square(vehicle.linear_damping, 6), square(vehicle.quadratic_damping, 6)
    sinks = (vehicle.mass - density * displaced_volume(vehicle, density)) * gravity
    capabilities = []
    for axis, name in enumerate(AXES):
        shares = [row[axis] for row in inverse]
        ahead, astern = _max_forces(vehicle, matrix, shares, axis)
        own_weight = sinks if name == "heave" else 0.0
        drag = quadratic[axis][axis] + equipment_drag(vehicle, density, axis)
        losses = [linear[axis][axis] + _loss(vehicle, matrix, shares, force, axis) for force in (ahead, astern)]
        speeds = (
            terminal_speed(ahead + own_weight, losses[0], drag),
            terminal_speed(astern + own_weight, losses[1], drag),
        )
        capabilities.append(AxisCapability(name, (ahead, astern), speeds if ahead else (0.0, 0.0)))
    return tuple(capabilities)


def _max_forces(vehicle: Vehicle, matrix: Matrix, thrusts: list[float], axis: int) -> tuple[float, float]:
    """Return the greatest forces in both directions; `thrusts` (N) are allocated for a unit force along `axis`."""
    wrench = [sum(a * f for a, f in zip(row, thrusts, strict=True)) for row in matrix]
    if _coupling(wrench, axis) > _MAX_COUPLING:
        return 0.0, 0.0
    ahead = astern = inf
    for thruster, thrust in zip(vehicle.thrusters, thrusts, strict=True):
        if abs(thrust) < 1e-9:
            continue
        with_it, against_it = thruster.max_forward / abs(thrust), thruster.max_reverse / abs(thrust)
        ahead = min(ahead, with_it if thrust > 0.0 else against_it)
        astern = min(astern, against_it if thrust > 0.0 else with_it)
    return ahead * wrench[axis], -astern * wrench[axis]


def _loss(vehicle: Vehicle, matrix: Matrix, shares: list[float], force: float, axis: int) -> float:
    """Return how much force along `axis` the propellers lose per m/s (N s/m) while they produce `force` N."""
    unscaled_force = sum(a * f for a, f in zip(matrix[axis], shares, strict=True))
    lost = 0.0
    for thruster, share, along in zip(vehicle.thrusters, shares, matrix[axis], strict=True):
        if isinstance(thruster.curve, Advance) and force:
            lost += along * along * thruster.curve.loss(share * force / unscaled_force, 1.0)
    return lost


def equipment_drag(vehicle: Vehicle, density: float, axis: int) -> float:
    """Return the quadratic damping (N s²/m²) that equipment adds in surge, sway or heave; 0 for the other axes."""
    if axis == 0:
        damping = square(vehicle.forward_speed_damping or (0.0,) * 6, 6)[0][0]
        areas = sum(fin.area * fin.parasitic_drag for fin in vehicle.fins)
        if vehicle.lift:
            areas += vehicle.lift.area * vehicle.lift.parasitic_drag
        return damping + 0.5 * density * areas
    flow = vehicle.cross_flow
    if flow is None or axis > 2:
        return 0.0
    length, width, height = vehicle.dimensions
    side = (flow.height or height) if axis == 1 else (flow.width or width)
    return 0.5 * density * flow.drag[-1] * (flow.length or length) * side


def _coupling(wrench: list[float], axis: int) -> float:
    """Return the greatest difference of `wrench` from a unit wrench along `axis`.

    A roll or pitch moment that comes with another axis does not count: weight and buoyancy balance it.
    """
    counts = [i for i in range(6) if i == axis or i not in (_ROLL, _PITCH)]
    return max(abs(wrench[i] - float(i == axis)) for i in counts)
