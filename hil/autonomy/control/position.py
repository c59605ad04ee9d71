"""Position loop: from a target position to the velocity command that leads there.

It is the outermost loop of the cascade, P with a speed limit. The velocity loop inside it controls the speed over
ground, so a current leaves no error. For vehicles that can move sideways and stop; one with fins needs a path to
follow.
"""

from collections.abc import Sequence
from math import cos, hypot, sin

from hil.autonomy.control.controller import HoldGains, VelocityCommand

# Slow enough for the velocity loops (about 4 1/s) not to overshoot, and for vehicles that pitch up at speed.
POSITION = HoldGains(p=0.5, limit=0.5)


def approach(
    target: Sequence[float],
    heading: float,
    position: Sequence[float],
    own_heading: float,
    gains: HoldGains = POSITION,
) -> VelocityCommand:
    """Return the command that leads a vehicle at `position` (m, NED) straight to `target` (m, NED) and holds it there.

    `heading` (rad from north, clockwise) is the target heading, `own_heading` the present one. The horizontal speed is
    `gains.p` times the distance, at most `gains.limit` m/s. Roll and pitch are not modelled.
    """
    north, east = target[0] - position[0], target[1] - position[1]
    distance = hypot(north, east)
    share = min(gains.p, gains.limit / distance) if distance else 0.0
    return VelocityCommand(
        surge=share * (north * cos(own_heading) + east * sin(own_heading)),
        sway=share * (east * cos(own_heading) - north * sin(own_heading)),
        depth=target[2],
        heading=heading,
    )
