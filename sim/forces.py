"""What else may push a vehicle: lifting surfaces, ballast, a tether, whatever a user adds.

A force of a user's own is a class named in the scenario; the keys beside `class` are its arguments:

    [[force]]
    class = "my_tether:Tether"
    length = 80.0
"""

from collections.abc import Sequence
from typing import Protocol

from sim.rotations import Rotation

Wrench = Sequence[float]  # X Y Z (N), K M N (N m) about the origin along the body axes


class Force(Protocol):
    """A force that is neither of the thrusters nor of the hull.

    `begin` is called once before each step, with the simulation time in ns at its start; `wrench` once for
    semi-implicit Euler, four times for Runge-Kutta, and must depend on nothing but its arguments and what
    `begin` has set, or a run cannot be repeated.
    """

    def begin(self, time_ns: int) -> None:
        """A step begins."""

    def wrench(self, position: Sequence[float], rotation: Rotation, nu_r: Sequence[float]) -> Wrench:
        """The wrench on a vehicle at `position` (m, NED), attitude `rotation` (body to world, 9 numbers).

        `nu_r` is the velocity through the water, u v w (m/s) p q r (rad/s) along the body axes.
        """
