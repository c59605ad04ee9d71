"""Effects of a sonar's own motion on one ping: the sonar moves and turns before the echoes arrive.

An echo from range r arrives t = 2 r / c after the ping. Let v be the sonar's velocity, w its angular velocity, and d
the direction of the object (unit vector). To first order in v / c and w t, the measured range is 1 - d v / c times the
true one, and the echo arrives from the direction d - w x d t.

A narrow receiving beam has turned away from the seabed that the pulse insonified: lines of a side scan fade while its
vehicle turns. The beams of a forward sonar receive the echoes of neighbouring directions. Not modelled: motion of the
objects.
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

_MIN_MOTION = 1e-4  # rad/s and m/s: slower motion is ignored
_MIN_SHIFT = 0.02  # in beams: smaller shifts are ignored


class PingMotion(NamedTuple):
    """Velocity (m/s) and angular velocity (rad/s) of a sonar during a ping, along its own axes."""

    velocity: Vector3
    angular_velocity: Vector3

    def apply(self, echoes: Echoes, directions: Floats, receiver_pattern: Callable[[Floats], Floats] | None) -> Echoes:
        """Return the echoes of rays along `directions` (unit vectors, n x 3), changed by the motion.

        `receiver_pattern` is the receiver's pattern (intensity, by unit vectors) that the rays' weights include; None:
        the receiver's beams cover all directions, and energies do not change.
        """
        if max(map(abs, self.velocity)) > _MIN_MOTION:
            echoes = echoes.scale_ranges(1.0 - directions @ np.array(self.velocity) / SOUND_SPEED)
        if receiver_pattern is not None and max(map(abs, self.angular_velocity)) > _MIN_MOTION:
            seconds = np.where(echoes.energy > 0.0, 2.0 * echoes.ranges / SOUND_SPEED, 0.0)
            before = receiver_pattern(directions)
            after = receiver_pattern(directions - np.cross(self.angular_velocity, directions) * seconds[:, None])
            echoes = echoes._replace(energy=echoes.energy * after / np.where(before > 0.0, before, 1.0))
        return echoes

    def shift_beams(self, echoes: Floats, bins: Bins, spacing: float) -> Floats:
        """Return echoes (beams x bins) shifted to the beams in which they arrive, `spacing` rad apart about z."""
        shift = self.angular_velocity[2] * 2.0 * bins.middles / (SOUND_SPEED * spacing)
        if np.abs(shift).max() < _MIN_SHIFT:
            return echoes
        whole_beams = np.floor(shift).astype(np.int64)
        rows, column = np.arange(len(echoes))[:, None] + whole_beams, np.arange(bins.count)
        padded = np.vstack([echoes, np.zeros((1, bins.count), echoes.dtype)])  # no echoes from outside the fan

        def at(rows: Any) -> Floats:
            received: Floats = padded[np.clip(rows, -1, len(echoes)), column]
            return received

        remainder = (shift - whole_beams).astype(echoes.dtype)
        shifted: Floats = (1 - remainder) * at(rows) + remainder * at(rows + 1)
        return shifted


def sonar_motion(state: State, mounting: Mounting, head_rotation: Quaternion | None) -> PingMotion:
    """Return the motion of a sonar along its axes, or those of its head (turned by `head_rotation`)."""
    orientation = multiply(mounting.quaternion, head_rotation) if head_rotation else mounting.quaternion
    return PingMotion(
        rotate_inverse(orientation, mounting.velocity(state.nu)), rotate_inverse(orientation, state.nu[3:6])
    )
