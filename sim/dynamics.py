"""The motion of a vehicle in six degrees of freedom: this file is the specification of the step.

Seen from the water, which moves steadily with the current, the vehicle obeys (Fossen 2021, eqs 6.1, 10.1)

    M nu_r' + C(nu_r) nu_r + D nu_r + Q |nu_r| nu_r = wrench - g(depth, attitude)

with nu_r = nu - R' current, and M the whole 6x6 of rigid body plus added mass: it is solved, so added mass
may be many times the mass. Seen from the ground nu' = nu_r' - omega x (R' current). The Coriolis term comes
from the momentum (l, h) = M nu_r, whatever M couples (Kirchhoff's equations):

    C(nu_r) nu_r = (omega x l,  v_r x l + omega x h)

Only + - * / and sqrt, in an order that the C twin (sim/native/kernel.h) repeats to the bit.
"""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Literal, NamedTuple

from sim import rotations
from sim.buoyancy import Hull
from sim.matrices import Matrix, inverse, is_diagonal, square
from sim.rotations import Rotation
from sim.vehicle import Vehicle, mass_matrix

if TYPE_CHECKING:
    from sim.forces import Force

Integrator = Literal["semi_implicit_euler", "rk4"]


class State:
    """Where the vehicle is and how it moves.

    `position` NED in m; `quaternion` (w, x, y, z) body to world; `nu` = u v w (m/s) and p q r (rad/s) over
    ground along the body axes; `nu_dot` its rate over the last step, which is what an accelerometer feels. To change
    one, give it whole: `sim.native.make_state` makes states that hand out copies.
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
    """What acts on a vehicle, term by term: force (N) and moment (N m) about the origin along the body axes.

    `coriolis` is that of rigid body and added mass, `others` that of everything in `sim.forces`; `total`, the
    sum of the others, is M nu_r'. The sign is that of the force: damping is against the motion.
    """

    coriolis: list[float]
    linear_damping: list[float]
    quadratic_damping: list[float]
    restoring: list[float]
    thrusters: list[float]
    others: list[float]
    total: list[float]


class Dynamics:
    """The equations of one vehicle in water of `density` kg/m³ under `gravity` m/s², pushed by `forces` too."""

    def __init__(
        self,
        vehicle: Vehicle,
        density: float,
        gravity: float,
        integrator: Integrator = "semi_implicit_euler",
        forces: "Sequence[Force]" = (),
    ) -> None:
        self._forces = forces
        self.mass = mass_matrix(vehicle)
        self.inverse_mass = inverse(self.mass)
        self.hull = Hull(vehicle, density, gravity)
        self.weight = vehicle.mass * gravity
        self._weight_moment = [self.weight * x for x in vehicle.center_of_gravity]
        self._linear = square(vehicle.linear_damping, 6)
        self._quadratic = square(vehicle.quadratic_damping, 6)
        self._diagonal = is_diagonal(self._linear) and is_diagonal(self._quadratic)
        self._damping = self._diagonal_damping if self._diagonal else self._full_damping
        self._linear_diagonal = [self._linear[i][i] for i in range(6)]
        self._quadratic_diagonal = [self._quadratic[i][i] for i in range(6)]
        steps: dict[Integrator, Callable[..., None]] = {"semi_implicit_euler": self._euler, "rk4": self._rk4}
        self._integrator = integrator
        self._advance = steps[integrator]

    def step(self, state: State, wrench: Sequence[float], current: Sequence[float], dt: float) -> None:
        """Move `state` on by `dt` s.

        `wrench` is the force (N) and moment (N m) of the thrusters about the origin along the body axes,
        `current` the velocity of the water NED in m/s; both hold during the step.
        """
        self._advance(state, wrench, current, dt)

    def acceleration(
        self, depth: float, rotation: Rotation, nu: Sequence[float], wrench: Sequence[float], current: Sequence[float]
    ) -> list[float]:
        """nu' (m/s², rad/s², body axes) at `depth` m of the origin and attitude `rotation`, body to world."""
        xx, xy, xz, yx, yy, yz, zx, zy, zz = rotation
        north, east, down = current
        water_u = xx * north + yx * east + zx * down
        water_v = xy * north + yy * east + zy * down
        water_w = xz * north + yz * east + zz * down
        u, v, w, p, q, r = nu
        u -= water_u
        v -= water_v
        w -= water_w
        lx, ly, lz, hx, hy, hz = _times(self.mass, u, v, w, p, q, r)
        dx, dy, dz, dk, dm, dn = self._damping(u, v, w, p, q, r)
        gx, gy, gz, gk, gm, gn = self._restoring(depth, rotation)
        tx, ty, tz, tk, tm, tn = wrench
        nu_dot = _times(
            self.inverse_mass,
            tx + gx - dx - (q * lz - r * ly),
            ty + gy - dy - (r * lx - p * lz),
            tz + gz - dz - (p * ly - q * lx),
            tk + gk - dk - (v * lz - w * ly + q * hz - r * hy),
            tm + gm - dm - (w * lx - u * lz + r * hx - p * hz),
            tn + gn - dn - (u * ly - v * lx + p * hy - q * hx),
        )
        nu_dot[0] += r * water_v - q * water_w
        nu_dot[1] += p * water_w - r * water_u
        nu_dot[2] += q * water_u - p * water_v
        return nu_dot

    def forces(self, state: State, wrench: Sequence[float], current: Sequence[float]) -> Forces:
        """The forces that make a step, apart; arguments as in `step`. For whoever wants to look."""
        rotation = rotations.matrix(state.quaternion)
        nu_r = _through_water(rotation, state.nu, current)
        u, v, w, p, q, r = nu_r
        lx, ly, lz, hx, hy, hz = _times(self.mass, u, v, w, p, q, r)
        coriolis = [
            r * ly - q * lz,
            p * lz - r * lx,
            q * lx - p * ly,
            w * ly - v * lz + r * hy - q * hz,
            u * lz - w * lx + p * hz - r * hx,
            v * lx - u * ly + q * hx - p * hy,
        ]
        linear = [-x for x in _times(self._linear, u, v, w, p, q, r)]
        quadratic = [-x for x in _times(self._quadratic, *(abs(x) * x for x in (u, v, w, p, q, r)))]
        restoring = list(self._restoring(state.position[2], rotation))
        others = self.push(state.position, rotation, state.nu, (0.0,) * 6, current)
        terms = (coriolis, linear, quadratic, restoring, list(wrench), list(others))
        return Forces(*terms, total=[sum(row) for row in zip(*terms, strict=True)])

    def push(
        self,
        position: Sequence[float],
        rotation: Rotation,
        nu: Sequence[float],
        wrench: Sequence[float],
        current: Sequence[float],
    ) -> Sequence[float]:
        """`wrench` with that of all other forces added."""
        nu_r = _through_water(rotation, nu, current)
        for force in self._forces:
            added = force.wrench(position, rotation, nu_r)
            wrench = [a + b for a, b in zip(wrench, added, strict=True)]
        return wrench

    def numbers(self) -> list[float]:
        """All that `step` uses, in a row: what the C twin is made of."""
        matrices = (self.mass, self.inverse_mass, self._linear, self._quadratic)
        flat = [x for matrix in matrices for row in matrix for x in row]
        kind = [float(self._diagonal), float(self._integrator == "rk4")]
        return [*flat, self.weight, *self._weight_moment, *self.hull.numbers(), *kind]

    def _restoring(self, depth: float, rotation: Rotation) -> tuple[float, float, float, float, float, float]:
        """Weight down and lift up, each at its own centre."""
        _, _, _, _, _, _, zx, zy, zz = rotation  # the world's down, along the body axes
        lift, lift_x, lift_y, lift_z = self.hull.lift(depth, rotation)
        heavy = self.weight - lift
        moment_x, moment_y, moment_z = self._weight_moment
        moment_x -= lift_x
        moment_y -= lift_y
        moment_z -= lift_z
        return (
            heavy * zx,
            heavy * zy,
            heavy * zz,
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
        linear = _times(self._linear, u, v, w, p, q, r)
        return [a + b for a, b in zip(linear, _times(self._quadratic, *squares), strict=True)]

    def _euler(self, state: State, wrench: Sequence[float], current: Sequence[float], dt: float) -> None:
        """Velocities first, then the pose with the new velocities: bounded energy where plain Euler gains it.

        Coriolis terms are those of the step's start: a body that tumbles at omega without any drag gains energy
        at about omega² dt a second. What drag there is in water is far more; Runge-Kutta has no such gain.
        """
        rotation = rotations.matrix(state.quaternion)
        if self._forces:
            wrench = self.push(state.position, rotation, state.nu, wrench, current)
        nu_dot = self.acceleration(state.position[2], rotation, state.nu, wrench, current)
        state.nu_dot = nu_dot
        state.nu = nu = [x + dt * dx for x, dx in zip(state.nu, nu_dot, strict=True)]
        state.position = [x + dt * dx for x, dx in zip(state.position, _over_ground(rotation, nu), strict=True)]
        state.quaternion = list(rotations.integrate(state.quaternion, nu[3:], dt))

    def _rk4(self, state: State, wrench: Sequence[float], current: Sequence[float], dt: float) -> None:
        """The classical Runge-Kutta step of fourth order."""
        start = [*state.position, *state.quaternion, *state.nu]

        def slope(at: Sequence[float]) -> list[float]:
            """The rate of the 13 numbers; `at` may be a quaternion not quite of length 1."""
            rotation = rotations.matrix(rotations.normalise(at[3:7]))
            nu = at[7:]
            pushed = self.push(at[:3], rotation, nu, wrench, current) if self._forces else wrench
            return [
                *_over_ground(rotation, nu),
                *rotations.multiply(at[3:7], (0.0, 0.5 * nu[3], 0.5 * nu[4], 0.5 * nu[5])),
                *self.acceleration(at[2], rotation, nu, pushed, current),
            ]

        k1 = slope(start)
        k2 = slope([x + 0.5 * dt * k for x, k in zip(start, k1, strict=True)])
        k3 = slope([x + 0.5 * dt * k for x, k in zip(start, k2, strict=True)])
        k4 = slope([x + dt * k for x, k in zip(start, k3, strict=True)])
        slopes = zip(k1, k2, k3, k4, strict=True)
        mean = [(a + 2.0 * (b + c) + d) / 6.0 for a, b, c, d in slopes]
        end = [x + dt * k for x, k in zip(start, mean, strict=True)]
        state.position, state.nu, state.nu_dot = end[:3], end[7:], mean[7:]
        state.quaternion = list(rotations.normalise(end[3:7]))


def _times(matrix: Matrix, u: float, v: float, w: float, p: float, q: float, r: float) -> list[float]:
    return [a * u + b * v + c * w + d * p + e * q + f * r for a, b, c, d, e, f in matrix]


def _over_ground(rotation: Rotation, nu: Sequence[float]) -> tuple[float, float, float]:
    xx, xy, xz, yx, yy, yz, zx, zy, zz = rotation
    u, v, w = nu[0], nu[1], nu[2]
    return xx * u + xy * v + xz * w, yx * u + yy * v + yz * w, zx * u + zy * v + zz * w


def _through_water(rotation: Rotation, nu: Sequence[float], current: Sequence[float]) -> list[float]:
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
