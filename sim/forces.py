"""The interface of additional forces on a vehicle: fins, ballast, a tether, or a user's own.

A user's own force is a class that the scenario names; the keys beside `class` are its arguments:

    [[force]]
    class = "my_tether:Tether"
    length = 80.0
"""

from collections.abc import Sequence
from typing import Protocol

from sim.rotations import Rotation

Wrench = Sequence[float]  # X Y Z (N), K M N (N m) about the origin along the body axes
# Buoyancy (N), and its centre times the buoyancy along the body axes (N m).
Buoyancy = tuple[float, float, float, float]


class Force(Protocol):
    """A force on the vehicle besides thrusters, weight, buoyancy and damping.

    `begin` is called once before each step, `wrench` once a step, for its middle. `wrench` must depend only on its
    arguments and on what `begin` has set, or a run cannot be repeated. A force of the air has the attribute
    `over_ground = True`: `nu_r` is then the velocity over ground.
    """

    def begin(self, time_ns: int) -> None:
        """Prepare for the step that begins at `time_ns`, in ns of simulation time; here there is nothing to do."""
        return

    def wrench(self, position: Sequence[float], rotation: Rotation, nu_r: Sequence[float]) -> Wrench:
        """Return the wrench on a vehicle at `position` (m, NED), attitude `rotation` (body to world, 9 numbers).

        `nu_r` is the velocity through the water, u v w (m/s) p q r (rad/s) along the body axes.
        """


class Twin(Protocol):
    """The C twin of a force that changes with time."""

    def begin(self, time: float, /) -> None:
        """Set the time, in s."""


class TimedForce(Force, Protocol):
    """A force that changes with time, which is `_time` s in a step; `twin` is its C twin, if there is one."""

    twin: Twin | None = None
    _time: float = 0.0

    def begin(self, time_ns: int) -> None:
        """Set the time for the next step."""
        self._time = time_ns * 1e-9
        if self.twin is not None:
            self.twin.begin(self._time)


def buoyancy_wrench(buoyancy: Buoyancy, rotation: Rotation) -> tuple[float, float, float, float, float, float]:
    """Return `buoyancy` as force (N) and moment (N m) about the origin, body axes; `rotation` is body to world."""
    force, x, y, z = buoyancy
    _, _, _, _, _, _, zx, zy, zz = rotation
    return -force * zx, -force * zy, -force * zz, z * zy - y * zz, x * zz - z * zx, y * zx - x * zy
