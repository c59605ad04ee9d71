"""The interface of additional forces on a vehicle: fins, ballast, a tether, or a user's own.

A force of a user's own is a class named in the scenario; the keys beside `class` are its arguments:

    [[force]]
    class = "my_tether:Tether"
    length = 80.0
"""

from collections.abc import Sequence
from typing import Protocol

from sim.rotations import Rotation

Wrench = Sequence[float]  # X Y Z (N), K M N (N m) about the origin along the body axes
# Lift in N and its moment's lever times it, along the body axes, in N m.
Lift = tuple[float, float, float, float]


class Force(Protocol):
    """A force that is neither of the thrusters nor of the hull.

    `begin` is called once before each step, with the simulation time in ns at its start; `wrench` once a step with
    Verlet, for its middle, and four times with Runge-Kutta. It must depend on nothing but its arguments and what
    `begin` has set, or a run cannot be repeated.
    """

    def begin(self, time_ns: int) -> None:
        """Prepare for a step that begins."""

    def wrench(self, position: Sequence[float], rotation: Rotation, nu_r: Sequence[float]) -> Wrench:
        """Return the wrench on a vehicle at `position` (m, NED), attitude `rotation` (body to world, 9 numbers).

        `nu_r` is the velocity through the water, u v w (m/s) p q r (rad/s) along the body axes.
        """


def lift_wrench(lift: Lift, rotation: Rotation) -> tuple[float, float, float, float, float, float]:
    """Return `lift` as force (N) and moment (N m) about the origin along the body axes; attitude is body to world."""
    force, x, y, z = lift
    _, _, _, _, _, _, zx, zy, zz = rotation
    return -force * zx, -force * zy, -force * zz, z * zy - y * zz, x * zz - z * zx, y * zx - x * zy
