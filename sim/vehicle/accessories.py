"""Accessories of a vehicle that move nothing but themselves: lights, the tilt of the cameras, a gripper.

Loaded only for a vehicle whose file has `[accessories]`. Positions are computed when they are read, from the last
command and the simulated time since then, so a step of the simulation does nothing for them.
"""

from math import inf, pi
from typing import Annotated, NamedTuple

from hil.common.schema import Range

NAMES = ("lights", "camera_tilt", "gripper")
LEAST = {"lights": 0.0, "camera_tilt": -1.0, "gripper": -1.0}  # least share of a command; the greatest is 1
STOPPED = 0.05  # a gripper's command nearer to 0 than this stops it


class AccessoryKeys(NamedTuple):
    """The accessories of a vehicle. Every key has a default, so an empty table `[accessories]` is enough.

    `lights` is the share of their full brightness that the lamps of cameras have until the first command. Commands turn
    cameras by up to `tilt` (rad) up or down at `tilt_rate` (rad/s). The gripper needs `gripper_time` (s) from closed to
    open.
    """

    lights: Annotated[float, Range(0.0, 1.0)] = 1.0
    tilt: Annotated[float, Range(0.001, 0.5 * pi, "rad")] = 0.25 * pi
    tilt_rate: Annotated[float, Range(0.01, 100.0, "rad/s")] = 0.5 * pi
    gripper_time: Annotated[float, Range(0.01, 600.0, "s")] = 3.0


class Motion(NamedTuple):
    """A motion from `start` to `target` that begins at `start_ns`, with `rate` a second; inf: at once."""

    start_ns: int
    start: float
    target: float
    rate: float

    def at(self, time_ns: int) -> float:
        """Return the position at a time."""
        gap = self.target - self.start
        if not gap or self.rate == inf:
            return self.target
        travelled = self.rate * max(0, time_ns - self.start_ns) * 1e-9
        return self.start + min(travelled / abs(gap), 1.0) * gap


class Accessories:
    """The accessories of one vehicle. Times are simulated time (ns).

    A command is a share: of full brightness for "lights" (0 to 1), of `tilt` for "camera_tilt" (-1 down, 1 up). For the
    "gripper", 1 opens it, -1 closes it and 0 stops it where it is; its position is 0 closed and 1 open.
    """

    def __init__(self, keys: AccessoryKeys) -> None:
        self._tilt = keys.tilt
        self._motions = {
            "lights": Motion(0, keys.lights, keys.lights, inf),
            "camera_tilt": Motion(0, 0.0, 0.0, keys.tilt_rate / keys.tilt),
            "gripper": Motion(0, 0.0, 0.0, 1.0 / keys.gripper_time),
        }

    def command(self, name: str, share: float, time_ns: int) -> None:
        """Move one of NAMES from now on; a share beyond its limits is limited."""
        target, motion = min(max(share, LEAST[name]), 1.0), self._motions[name]
        position = motion.at(time_ns)
        if name == "gripper":
            target = position if abs(target) < STOPPED else float(target > 0.0)
        if target != motion.target:
            self._motions[name] = Motion(time_ns, position, target, motion.rate)

    def place(self, lights: float, tilt: float) -> None:
        """Set brightness and tilt (rad) at once, as they are in another process."""
        for name, position in (("lights", lights), ("camera_tilt", tilt / self._tilt)):
            self._motions[name] = Motion(0, position, position, inf)

    def positions(self, time_ns: int) -> dict[str, float]:
        """Return the position of each of NAMES, as shares."""
        return {name: motion.at(time_ns) for name, motion in self._motions.items()}

    def lights(self, time_ns: int) -> float:
        """Return the share of their full brightness that the lamps have."""
        return self._motions["lights"].at(time_ns)

    def tilt(self, time_ns: int) -> float:
        """Return the angle in rad by which cameras are turned up."""
        return self._tilt * self._motions["camera_tilt"].at(time_ns)
