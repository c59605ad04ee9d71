"""Equations of motion of a vehicle in six degrees of freedom. This file is the specification of the step.

Seen from the water, which moves steadily with the current, the vehicle follows (Fossen 2021, eqs 6.1, 10.1)

    M nu_r' + C(nu_r) nu_r + D nu_r + Q |nu_r| nu_r = wrench - g(depth, attitude)

with nu_r = nu - R' current, and M the full 6x6 matrix of rigid body plus added mass. The system is solved with M, so
added mass may be many times the mass. Seen from the ground nu' = nu_r' - omega x (R' current). The Coriolis term comes
from the momentum (l, h) = M nu_r, for any coupling in M (Kirchhoff's equations):

    C(nu_r) nu_r = (omega x l,  v_r x l + omega x h)

`munk_share` of a vehicle may reduce this term. With l_A = A11 v_r, the linear momentum of the added mass (A11: the
upper left 3x3 block of added mass), v_r x l_A is the Munk moment, which turns a body broadside to the flow. In a real
fluid the flow separates, and the moment is smaller. For shares s = (s_p, s_q, s_r), with * for the product element by
element, these forces and moments are added:

    relief = ((1 - s) * omega x l_A,  (1 - s) * (v_r x l_A))

Smaller moments alone would not conserve energy. With the forces beside them nu_r . relief = 0 for any shares: the
relief does no work.

A step moves half its way, computes the acceleration there and the new velocity, and moves the other half (Verlet 1967,
Phys. Rev. 159). Terms that depend on velocity use a predicted one, nu + nu_dot dt / 2 (Groot & Warren 1997, J. Chem.
Phys. 107). The prediction is reduced where a step is long for the damping, so that the method is stable up to a damping
rate of 2 / dt, as Euler's is. It is of second order with one evaluation of the forces a step, and springs (lift at the
surface, righting moments) neither gain nor lose energy. Thrust is held within a step at the value of its end
(sim/vehicle/thrusters/bank.py), so while thrusters change their speed it is of first order. Greatest errors in 10 s of
bluerov2_heavy_vonbenzon2022 under a constant wrench, compared with semi-implicit Euler
(tests/unit/sim/test_integrators.py):

                                       semi-implicit   this
    from rest, 40 N: position (m)
      steps of 2.5 ms                  1.0e-3          1.3e-6
      steps of 10 ms                   4.0e-3          2.4e-5
    into a turn, 40 N and 3 N m
      steps of 2.5 ms: position (m)    1.2e-3          2.6e-6
                       quaternion      1.5e-3          1.2e-6
      steps of 10 ms: position (m)     4.7e-3          3.7e-5
    time of a step in C, relative to semi-implicit Euler
                                       1.0             1.1

The step uses only + - * / and sqrt, in an order that the C twin (sim/native/kernel.h) repeats, so that both give the
same bits. Some forces (sim/forces.py) need sines and powers: Python and the twin (sim/native/forces.h) both call the
C library for them.
"""

from collections.abc import Callable, Sequence
from math import isfinite
from typing import TYPE_CHECKING, NamedTuple

from hil.common.vectors import Quaternion
from sim import rotations
from sim.matrices import inverse, is_diagonal, square, times
from sim.rotations import Rotation
from sim.vehicle.buoyancy import Hull
from sim.vehicle.vehicle import Vehicle, mass_matrix

if TYPE_CHECKING:
    from sim.forces import Force


class State:
    """Position, attitude and velocity of the vehicle.

    `position` is NED in m, `quaternion` (w, x, y, z) body to world. `nu` = u v w (m/s) and p q r (rad/s) is the
    velocity over ground along the body axes. `nu_dot` is its rate of change over the last step: accelerometers measure
    it, and the next step uses it for its prediction. Assign a whole sequence to change one, never an element:
    states of `sim.assembly.make_state` return copies.
    """

    __slots__ = ("nu", "nu_dot", "position", "quaternion")

    def __init__(
        self,
        position: Sequence[float] = (0.0, 0.0, 0.0),
        quaternion: Sequence[float] = (1.0, 0.0, 0.0, 0.0),
        nu: Sequence[float] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    ) -> None:
        self.position: Sequence[float] = list(position)
        self.quaternion: Sequence[float] = list(quaternion)
        self.nu: Sequence[float] = list(nu)
        self.nu_dot: Sequence[float] = [0.0] * 6


class Forces(NamedTuple):
    """Forces on a vehicle, term by term: force (N) and moment (N m) about the origin along the body axes.

    `coriolis` is that of rigid body and added mass, reduced by `munk_share`. `others` is the sum of the additional
    forces (sim/forces.py), `contact` the force of obstacles and seabed (sim/environment/collision.py). `total` is the
    sum of all terms, which equals M nu_r'. Signs are those of forces on the vehicle: damping opposes the motion.
    """

    coriolis: list[float]
    linear_damping: list[float]
    quadratic_damping: list[float]
    restoring: list[float]
    thrusters: list[float]
    others: list[float]
    contact: list[float]
    total: list[float]


class Dynamics:
    """The equations of one vehicle in water of `density` kg/m³ under `gravity` m/s², with additional `forces`."""

    def __init__(self, vehicle: Vehicle, density: float, gravity: float, forces: "Sequence[Force]" = ()) -> None:
        self.others = forces
        self._over_ground = [getattr(force, "over_ground", False) for force in forces]
        self.mass = mass_matrix(vehicle)
        self.inverse_mass = inverse(self.mass)
        self._added_mass_linear = [row[:3] for row in square(vehicle.added_mass, 6)[:3]]
        self._munk_reduction = [1.0 - share for share in vehicle.munk_share]
        self._reduces_munk = any(self._munk_reduction)
        self.hull = Hull(vehicle, density, gravity)
        self.weight = vehicle.mass * gravity
        self._weight_moment = [self.weight * x for x in vehicle.center_of_gravity]
        self._linear = square(vehicle.linear_damping, 6)
        self._quadratic = square(vehicle.quadratic_damping, 6)
        self._diagonal = is_diagonal(self._linear) and is_diagonal(self._quadratic)
        self._damping = self._diagonal_damping if self._diagonal else self._full_damping
        self._linear_diagonal = [self._linear[i][i] for i in range(6)]
        self._quadratic_diagonal = [self._quadratic[i][i] for i in range(6)]
        # Rate at which damping reduces each velocity (1/s), and its slope over the speed.
        self._rates = [self._linear[i][i] * self.inverse_mass[i][i] for i in range(6)]
        self._slopes = [2.0 * self._quadratic[i][i] * self.inverse_mass[i][i] for i in range(6)]
        self._advance: Callable[..., None] = self._advance_in_python

    def step(self, state: State, wrench: Sequence[float], current: Sequence[float], dt: float) -> None:
        """Advance `state` by `dt` s.

        `wrench` is the force (N) and moment (N m) of the thrusters about the origin along the body axes,
        `current` the velocity of the water (NED, m/s); both are constant during the step. Raises FloatingPointError,
        with `state` unchanged, if the new state would not be finite.
        """
        self._advance(state, wrench, current, dt)

    def acceleration(
        self, depth: float, rotation: Rotation, nu: Sequence[float], wrench: Sequence[float], current: Sequence[float]
    ) -> list[float]:
        """Return nu' (m/s², rad/s², body axes) for the origin at `depth` m and attitude `rotation` (body to world).

        The other arguments are those of `step`.
        """
        xx, xy, xz, yx, yy, yz, zx, zy, zz = rotation
        north, east, down = current
        water_u = xx * north + yx * east + zx * down
        water_v = xy * north + yy * east + zy * down
        water_w = xz * north + yz * east + zz * down
        u, v, w, p, q, r = nu
        u -= water_u
        v -= water_v
        w -= water_w
        lx, ly, lz, hx, hy, hz = times(self.mass, u, v, w, p, q, r)
        dx, dy, dz, dk, dm, dn = self._damping(u, v, w, p, q, r)
        gx, gy, gz, gk, gm, gn = self._restoring(depth, rotation)
        tx, ty, tz, tk, tm, tn = wrench
        force = [
            tx + gx - dx - (q * lz - r * ly),
            ty + gy - dy - (r * lx - p * lz),
            tz + gz - dz - (p * ly - q * lx),
            tk + gk - dk - (v * lz - w * ly + q * hz - r * hy),
            tm + gm - dm - (w * lx - u * lz + r * hx - p * hz),
            tn + gn - dn - (u * ly - v * lx + p * hy - q * hx),
        ]
        if self._reduces_munk:
            force = [a + b for a, b in zip(force, self._munk_relief(u, v, w, p, q, r), strict=True)]
        nu_dot = times(self.inverse_mass, *force)
        nu_dot[0] += r * water_v - q * water_w
        nu_dot[1] += p * water_w - r * water_u
        nu_dot[2] += q * water_u - p * water_v
        return nu_dot

    def forces(self, state: State, wrench: Sequence[float], current: Sequence[float]) -> Forces:
        """Return the forces that act in a step, term by term, for inspection. The arguments are those of `step`."""
        rotation = rotations.matrix(state.quaternion)
        nu_r = velocity_through_water(rotation, state.nu, current)
        u, v, w, p, q, r = nu_r
        lx, ly, lz, hx, hy, hz = times(self.mass, u, v, w, p, q, r)
        coriolis = [
            r * ly - q * lz,
            p * lz - r * lx,
            q * lx - p * ly,
            w * ly - v * lz + r * hy - q * hz,
            u * lz - w * lx + p * hz - r * hx,
            v * lx - u * ly + q * hx - p * hy,
        ]
        coriolis = [a + b for a, b in zip(coriolis, self._munk_relief(u, v, w, p, q, r), strict=True)]
        linear = [-x for x in times(self._linear, u, v, w, p, q, r)]
        quadratic = [-x for x in times(self._quadratic, *(abs(x) * x for x in (u, v, w, p, q, r)))]
        restoring = list(self._restoring(state.position[2], rotation))
        others = self.add_forces(state.position, rotation, state.nu, (0.0,) * 6, current)
        terms = (coriolis, linear, quadratic, restoring, list(wrench), list(others), [0.0] * 6)
        return Forces(*terms, total=[sum(row) for row in zip(*terms, strict=True)])

    def add_forces(
        self,
        position: Sequence[float],
        rotation: Rotation,
        nu: Sequence[float],
        wrench: Sequence[float],
        current: Sequence[float],
    ) -> Sequence[float]:
        """Return `wrench` plus the wrenches of all additional forces."""
        nu_r = velocity_through_water(rotation, nu, current)
        for force, over_ground in zip(self.others, self._over_ground, strict=True):
            added = force.wrench(position, rotation, nu if over_ground else nu_r)
            wrench = [a + b for a, b in zip(wrench, added, strict=True)]
        return wrench

    def numbers(self) -> list[float]:
        """Return all numbers that `step` uses as one flat list, from which the C twin is made."""
        matrices = (self.mass, self.inverse_mass, self._linear, self._quadratic)
        flat = [x for matrix in matrices for row in matrix for x in row]
        moved = [x for row in self._added_mass_linear for x in row]
        kind = [float(self._diagonal), float(self._reduces_munk)]
        return [*flat, self.weight, *self._weight_moment, *self.hull.numbers(), *moved, *self._munk_reduction, *kind]

    def _munk_relief(self, u: float, v: float, w: float, p: float, q: float, r: float) -> Sequence[float]:
        """Return the wrench (N, N m) by which `munk_share` reduces the Coriolis term. It does no work."""
        lx, ly, lz = [a * u + b * v + c * w for a, b, c in self._added_mass_linear]
        reduction_k, reduction_m, reduction_n = self._munk_reduction
        p *= reduction_k
        q *= reduction_m
        r *= reduction_n
        return (
            q * lz - r * ly,
            r * lx - p * lz,
            p * ly - q * lx,
            reduction_k * (v * lz - w * ly),
            reduction_m * (w * lx - u * lz),
            reduction_n * (u * ly - v * lx),
        )

    def _restoring(self, depth: float, rotation: Rotation) -> tuple[float, float, float, float, float, float]:
        """Return the wrench of weight at the centre of gravity and of buoyancy at the centre of buoyancy (N, N m)."""
        _, _, _, _, _, _, zx, zy, zz = rotation  # the world's down axis, in body axes
        lift, lift_x, lift_y, lift_z = self.hull.buoyancy(depth, (zx, zy, zz))
        excess = self.weight - lift
        moment_x, moment_y, moment_z = self._weight_moment
        moment_x -= lift_x
        moment_y -= lift_y
        moment_z -= lift_z
        return (
            excess * zx,
            excess * zy,
            excess * zz,
            moment_y * zz - moment_z * zy,
            moment_z * zx - moment_x * zz,
            moment_x * zy - moment_y * zx,
        )

    def _diagonal_damping(self, u: float, v: float, w: float, p: float, q: float, r: float) -> Sequence[float]:
        a, b, c, d, e, f = self._linear_diagonal
        aa, bb, cc, dd, ee, ff = self._quadratic_diagonal
        return (
            (a + aa * abs(u)) * u,
            (b + bb * abs(v)) * v,
            (c + cc * abs(w)) * w,
            (d + dd * abs(p)) * p,
            (e + ee * abs(q)) * q,
            (f + ff * abs(r)) * r,
        )

    def _full_damping(self, u: float, v: float, w: float, p: float, q: float, r: float) -> Sequence[float]:
        squares = (abs(u) * u, abs(v) * v, abs(w) * w, abs(p) * p, abs(q) * q, abs(r) * r)
        linear = times(self._linear, u, v, w, p, q, r)
        return [a + b for a, b in zip(linear, times(self._quadratic, *squares), strict=True)]

    def predict_midpoint(
        self, state: State, dt: float
    ) -> tuple[Sequence[float], Rotation, Sequence[float], Quaternion]:
        """Return position (m, NED), rotation, predicted nu and quaternion in the middle of a Verlet step of `dt` s."""
        half = 0.5 * dt
        nu = state.nu
        attitude = rotations.integrate(state.quaternion, nu[3:], half)
        rotation = rotations.matrix(attitude)
        position = [x + half * dx for x, dx in zip(state.position, _over_ground(rotation, nu), strict=True)]
        rows = zip(nu, state.nu_dot, self._rates, self._slopes, strict=True)
        predicted = [x + half * max(0.0, 1.0 - dt * (rate + slope * abs(x))) * dx for x, dx, rate, slope in rows]
        return position, rotation, predicted, attitude

    def _advance_in_python(self, state: State, wrench: Sequence[float], current: Sequence[float], dt: float) -> None:
        """Move half a step at the old velocities, accelerate there, move the other half at the new velocities."""
        position, rotation, predicted, attitude = self.predict_midpoint(state, dt)
        if self.others:
            wrench = self.add_forces(position, rotation, predicted, wrench, current)
        nu_dot = self.acceleration(position[2], rotation, predicted, wrench, current)
        half = 0.5 * dt
        nu = [x + dt * dx for x, dx in zip(state.nu, nu_dot, strict=True)]
        moved = [x + half * dx for x, dx in zip(position, _over_ground(rotation, nu), strict=True)]
        _set_state(state, moved, list(rotations.integrate(attitude, nu[3:], half)), nu, nu_dot)


def _set_state(
    state: State, position: list[float], quaternion: list[float], nu: list[float], nu_dot: list[float]
) -> None:
    """Set `state` to these numbers. Raises FloatingPointError, with `state` unchanged, if one is not finite."""
    if not isfinite(sum(position) + sum(quaternion) + sum(nu)):
        raise FloatingPointError("the state is not finite any more")
    state.position, state.quaternion, state.nu, state.nu_dot = position, quaternion, nu, nu_dot


def _over_ground(rotation: Rotation, nu: Sequence[float]) -> tuple[float, float, float]:
    """Return the velocity over ground (NED, m/s) of a body that moves with `nu`."""
    xx, xy, xz, yx, yy, yz, zx, zy, zz = rotation
    u, v, w = nu[0], nu[1], nu[2]
    return xx * u + xy * v + xz * w, yx * u + yy * v + yz * w, zx * u + zy * v + zz * w


def velocity_through_water(rotation: Rotation, nu: Sequence[float], current: Sequence[float]) -> list[float]:
    """Return nu_r (m/s, rad/s, body axes), the velocity through the water of a body that moves with `nu` over ground.

    The water flows with `current` (m/s, NED).
    """
    xx, xy, xz, yx, yy, yz, zx, zy, zz = rotation
    north, east, down = current
    u, v, w, p, q, r = nu
    return [
        u - (xx * north + yx * east + zx * down),
        v - (xy * north + yy * east + zy * down),
        w - (xz * north + yz * east + zz * down),
        p,
        q,
        r,
    ]
