"""Vehicle model of a model-based controller: inertia, drag, weight and buoyancy, after Fossen's model.

M nu' + C(nu) nu + D(nu) nu + g(orientation) = wrench of the thrusters (Fossen 2021, "Handbook of Marine Craft
Hydrodynamics and Motion Control", eq. 6.1). Currents are unknown here, and coupling between the axes is left out of
damping and inertia.
"""

from typing import NamedTuple

from hil.autonomy.control.controller import ABSURD, Navigation, Wrench, down_in_body
from hil.common.vectors import Quaternion, Vector3


class Plant(NamedTuple):
    """Model of a vehicle about its body origin, along FRD; surge, sway, heave, roll, pitch, yaw.

    `inertia` is the diagonal of rigid-body plus added mass, kg and kg m². `linear_damping` (N s/m, N m s) and
    `quadratic_damping` (N s²/m², N m s²) are positive if they brake. `weight` and `buoyancy` in N act at
    `center_of_gravity` and `center_of_buoyancy`, m. `translational_added_mass` (kg) is that of surge, sway and heave,
    which `inertia` includes; `munk_share` is the remaining share of its Munk moment about roll, pitch and yaw
    (sim/dynamics.py).
    """

    inertia: Wrench
    linear_damping: Wrench
    quadratic_damping: Wrench
    weight: float
    buoyancy: float
    center_of_gravity: Vector3 = (0.0, 0.0, 0.0)
    center_of_buoyancy: Vector3 = (0.0, 0.0, 0.0)
    translational_added_mass: Vector3 = (0.0, 0.0, 0.0)
    munk_share: Vector3 = (1.0, 1.0, 1.0)

    def load(self, navigation: Navigation, reference: Wrench) -> Wrench:
        """Return the wrench (N, N m) that maintains `reference` (m/s, rad/s) against drag, weight, lift and Coriolis.

        Drag is D(nu) nu_ref, with the coefficients of the present speed and the reference velocity, which keeps the
        water's own damping of an error (Slotine & Li 1991, "Applied Nonlinear Control", section 9.2). A component that
        is nan or absurd counts as 0.
        """
        nu = navigation.velocity + navigation.angular_velocity
        drag = [
            (linear + quadratic * abs(speed)) * wanted
            for linear, quadratic, speed, wanted in zip(
                self.linear_damping, self.quadratic_damping, nu, reference, strict=True
            )
        ]
        lift, turning = self.restoring(navigation.orientation), self.coriolis(nu)
        x, y, z, k, m, n = (
            value if abs(value) < ABSURD * mass else 0.0
            for value, mass in zip(map(sum, zip(drag, lift, turning, strict=True)), self.inertia, strict=True)
        )
        return x, y, z, k, m, n

    def restoring(self, orientation: Quaternion) -> Wrench:
        """Return the wrench (N, N m) that balances weight and buoyancy at this orientation (Fossen 2021, eq. 4.6)."""
        x, y, z = down_in_body(orientation)
        gravity, buoyancy = self.center_of_gravity, self.center_of_buoyancy
        a, b, c = (self.weight * g - self.buoyancy * f for g, f in zip(gravity, buoyancy, strict=True))
        excess = self.weight - self.buoyancy
        return -excess * x, -excess * y, -excess * z, c * y - b * z, a * z - c * x, b * x - a * y

    def coriolis(self, nu: Wrench) -> Wrench:
        """Return C(nu) nu (N, N m) for a diagonal inertia (Fossen 2021, eq. 3.46).

        The lost share of the Munk moment is subtracted, with the forces that belong to it.
        """
        u, v, w, p, q, r = nu
        x, y, z, k, m, n = (mass * speed for mass, speed in zip(self.inertia, nu, strict=True))
        a, b, c = (mass * speed for mass, speed in zip(self.translational_added_mass, (u, v, w), strict=True))
        lost_k, lost_m, lost_n = (1.0 - share for share in self.munk_share)
        return (
            q * (z - lost_m * c) - r * (y - lost_n * b),
            r * (x - lost_n * a) - p * (z - lost_k * c),
            p * (y - lost_k * b) - q * (x - lost_m * a),
            v * (z - lost_k * c) - w * (y - lost_k * b) + q * n - r * m,
            w * (x - lost_m * a) - u * (z - lost_m * c) + r * k - p * n,
            u * (y - lost_n * b) - v * (x - lost_n * a) + p * m - q * k,
        )
