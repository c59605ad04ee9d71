"""Effects of a sonar's own motion on one ping: it has moved on and turned when the echoes come.

An echo from range r comes t = 2 r / c after the ping. With v the sonar's velocity and w its turn rate, to first order
in v / c and w t: the range is measured 1 - d v / c times as long, d being the direction of the thing, which by then
stands in the direction d - w x d t. Where the receiver's beam is narrow it has turned away from what was lit: lines of
a side scan fade while its vehicle turns. Beams of a forward sonar receive what stood beside them. Things stand
still, and second echoes are as long as those of a sonar at rest.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from hil.common.vectors import Quaternion, Vector3
from sim.dynamics import State
from sim.environment.seawater.water_column import SOUND_SPEED
from sim.rotations import multiply, rotate_inverse
from sim.sensors.imaging.echoes import Bins, Echoes, Floats
from sim.sensors.mounting import Mounting

_STILL = 1e-4  # rad/s, m/s
_LEAST_SHIFT = 0.02  # of a beam


class PingMotion(NamedTuple):
    """Velocity (m/s) and turn rate (rad/s) of a sonar during a ping, in its own axes."""

    velocity: Vector3
    spin: Vector3

    def apply(self, echoes: Echoes, directions: Floats, receive: Callable[[Floats], Floats] | None) -> Echoes:
        """Return the echoes of rays (unit vectors, n x 3) as they come.

        `receive` is the receiver's pattern (intensity) by unit vectors, as it is in the rays' weights; None for one
        that receives all of them alike.
        """
        if max(map(abs, self.velocity)) > _STILL:
            echoes = echoes.moved(1.0 - directions @ np.array(self.velocity) / SOUND_SPEED)
        if receive is not None and max(map(abs, self.spin)) > _STILL:
            seconds = np.where(echoes.energy > 0.0, 2.0 * echoes.ranges / SOUND_SPEED, 0.0)
            before = receive(directions)
            after = receive(directions - np.cross(self.spin, directions) * seconds[:, None])
            echoes = echoes._replace(energy=echoes.energy * after / np.where(before > 0.0, before, 1.0))
        return echoes

    def turn_beams(self, shares: Floats, bins: Bins, spacing: float) -> Floats:
        """Return echoes (beams x bins) by the directions in which they come, of beams `spacing` rad apart about z."""
        shift = self.spin[2] * 2.0 * (bins.first + (np.arange(bins.count) + 0.5) * bins.step) / (SOUND_SPEED * spacing)
        if np.abs(shift).max() < _LEAST_SHIFT:
            return shares
        whole = np.floor(shift).astype(np.int64)
        places, column = np.arange(len(shares))[:, None] + whole, np.arange(bins.count)
        padded = np.vstack([shares, np.zeros((1, bins.count), shares.dtype)])  # beyond the fan nothing is lit

        def at(places: Any) -> Floats:
            received: Floats = padded[np.where((places >= 0) & (places < len(shares)), places, -1), column]
            return received

        later = (shift - whole).astype(shares.dtype)
        turned: Floats = (1 - later) * at(places) + later * at(places + 1)
        return turned


def motion_of(state: State, mounting: Mounting, turned: Quaternion | None) -> PingMotion | None:
    """Return the motion of a sonar whose head, if it has one, stands `turned` in its axes; None at rest."""
    if max(map(abs, state.nu)) <= _STILL:
        return None
    own = multiply(mounting.quaternion, turned) if turned else mounting.quaternion
    return PingMotion(rotate_inverse(own, mounting.velocity(state.nu)), rotate_inverse(own, state.nu[3:6]))
