"""PD control law that compensates restoring forces and drag by a model.

    acceleration = d (target velocity - velocity),    wrench = inertia x acceleration + drag, weight, Coriolis

(Takegaki & Arimoto, ASME Journal of Dynamic Systems, Measurement, and Control 103(2), 1981; Fossen 2021, section 15.3).
Depth, heading, roll and pitch errors enter through the target velocity, so the outer loop's p times d is the spring
constant. Without an integrator nothing winds up. A force f that the model lacks leaves a velocity error of
f / (inertia d), or, divided by the outer loop's p, an error of depth or heading.
"""

from typing import Annotated, ClassVar, NamedTuple

from hil.autonomy.control.controller import (
    ABSURD,
    NO_RESIDUAL,
    Gains,
    Navigation,
    VelocityCommand,
    Wrench,
    clamp,
    velocity_targets,
)
from hil.autonomy.control.model import Plant
from hil.common.schema import Range


class Damper(NamedTuple):
    """One axis: `d` in 1/s, and `limit` in m/s² or rad/s², the limit of the wrench over the inertia."""

    d: Annotated[float, Range(0.0, 100.0)]
    limit: Annotated[float, Range(1e-3, 1e3)] = 10.0


class PdSettings(NamedTuple):
    """`[control.restoring_pd]`; the defaults suit a vehicle whose thrusters respond within about 0.1 s."""

    surge: Damper = Damper(5.0)
    sway: Damper = Damper(5.0)
    heave: Damper = Damper(5.0)
    roll_rate: Damper = Damper(6.0, 20.0)
    pitch_rate: Damper = Damper(6.0, 20.0)
    yaw_rate: Damper = Damper(6.0, 20.0)


class RestoringPd:
    """A `Controller` (hil/autonomy/control/families.py) for a vehicle like `plant`, with `gains` of the outer loops.

    Not modelled: thruster lag, currents, coupling of the axes by mass.
    """

    Settings: ClassVar = PdSettings

    def __init__(self, plant: Plant, gains: Gains, settings: PdSettings = PdSettings()) -> None:
        self._plant = plant
        self._gains = gains
        self._settings = settings

    def reset(self) -> None:
        """Do nothing: the law has no state."""

    def update(
        self, command: VelocityCommand, navigation: Navigation, dt: float, residual: Wrench = NO_RESIDUAL
    ) -> Wrench:
        """Return the wrench (X, Y, Z in N; K, M, N in N m; along FRD); `dt` and `residual` are not used."""
        targets = velocity_targets(command, navigation, self._gains)
        measured = navigation.velocity + navigation.angular_velocity
        load = self._plant.load(navigation, targets)
        x, y, z, k, m, n = (
            clamp(inertia * _damping_acceleration(damper, target - value) + held, inertia * damper.limit)
            for inertia, damper, target, value, held in zip(
                self._plant.inertia, self._settings, targets, measured, load, strict=True
            )
        )
        return x, y, z, k, m, n


def _damping_acceleration(damper: Damper, error: float) -> float:
    """Return the acceleration against a velocity error; 0 if the error is not finite."""
    return damper.d * error if abs(error) < ABSURD else 0.0
