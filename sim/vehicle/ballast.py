"""Ballast of a vehicle: a variable buoyancy engine, and weights that it can drop."""

from collections.abc import Sequence
from typing import Annotated, NamedTuple

from hil.common.schema import Range
from sim.forces import Force, Wrench, buoyancy_wrench
from sim.rotations import Rotation
from sim.vehicle.servos import Servos
from sim.vehicle.thrusters.model import PULSE_MAX_US, Point, Pulse, is_pulse

RELEASE_US = 1700  # a longer pulse, up to PULSE_MAX_US, drops a weight

Volume = Annotated[float, Range(0.0, 100.0, "m³")]


class BuoyancyEngine(NamedTuple):
    """A bladder at `position` that a pump fills and empties: volumes in m³, `rate` in m³/s.

    The vehicle's own volume includes `neutral_volume`: at this volume the engine adds no buoyancy, and it starts there.
    A pulse commands a volume: `pwm_neutral_us` the neutral one, the ends of the pulse range the least and the greatest,
    linear in between. Without a valid pulse (800..2200 us) the volume does not change. Not modelled: the mass of the
    fluid that is pumped within the vehicle, its power, slower pumping at depth, an engine above the water.
    """

    position: Point
    min_volume: Volume
    neutral_volume: Volume
    max_volume: Volume
    rate: Annotated[float, Range(1e-9, 10.0, "m³/s")]
    pwm_neutral_us: Pulse = 1500
    pwm_min_us: Pulse = 1100
    pwm_max_us: Pulse = 1900

    def validate(self) -> str | None:
        """Return what is wrong with the combination of the keys, or None."""
        if not self.min_volume <= self.neutral_volume <= self.max_volume:
            return "volumes must grow from min_volume over neutral_volume to max_volume"
        if not self.pwm_min_us < self.pwm_neutral_us < self.pwm_max_us:
            return "pulses must grow from pwm_min_us over pwm_neutral_us to pwm_max_us"
        return None

    def volume(self, pwm_us: int) -> float:
        """Return the volume (m³) that a pulse commands."""
        offset = pwm_us - self.pwm_neutral_us
        if offset > 0:
            share = min(1.0, offset / (self.pwm_max_us - self.pwm_neutral_us))
            return self.neutral_volume + share * (self.max_volume - self.neutral_volume)
        share = min(1.0, offset / (self.pwm_min_us - self.pwm_neutral_us))
        return self.neutral_volume + share * (self.min_volume - self.neutral_volume)


class Bladder(Force):
    """The force of a buoyancy engine in water of `specific_weight` (N/m³), stepped every `dt` s."""

    def __init__(self, engine: BuoyancyEngine, specific_weight: float, dt: float) -> None:
        self._engine = engine
        self._specific_weight = specific_weight
        self.servos = Servos([engine.neutral_volume], [1.0], [engine.rate * dt])
        self._pwm_us = 0

    @property
    def volume(self) -> float:
        """The present volume in m³."""
        return self.servos.values[0]

    def step(self, pwm_us: int) -> None:
        """Pump for one step towards the volume of this pulse (us)."""
        self.command(pwm_us)
        self.servos.step()

    def command(self, pwm_us: int) -> None:
        """Set the target to the volume of this pulse (us); without a valid pulse the pump stops."""
        if pwm_us != self._pwm_us:
            self.servos.set_targets([self._engine.volume(pwm_us) if is_pulse(pwm_us) else self.volume])
            self._pwm_us = pwm_us

    def wrench(self, position: Sequence[float], rotation: Rotation, nu_r: Sequence[float]) -> Wrench:
        """Return the buoyancy beyond that of the neutral volume (N, N m, body axes about the origin)."""
        force = self._specific_weight * (self.volume - self._engine.neutral_volume)
        x, y, z = self._engine.position
        return buoyancy_wrench((force, force * x, force * y, force * z), rotation)

    def numbers(self) -> list[float]:
        """Return all numbers that `wrench` uses, except the volume, as one flat list, for the C twin."""
        return [*self._engine.position, self._specific_weight, self._engine.neutral_volume]


class DropWeight(NamedTuple):
    """A weight at `position` that the vehicle can drop. Its mass and volume (m³) are included in the vehicle's.

    A pulse above 1700 us on its channel releases it permanently.
    """

    name: str
    mass: Annotated[float, Range(1e-3, 1e5, "kg")]
    position: Point
    volume: Volume = 0.0

    def validate(self) -> str | None:
        """Return an error if the weight has no name, else None."""
        return None if self.name else "name: give one"


class Release(NamedTuple):
    """The drop weight `name` is dropped at `time` s of simulated time, independently of the pulses."""

    name: str
    time: Annotated[float, Range(0.0, 1e7, "s")] = 0.0


def is_release(pwm_us: int) -> bool:
    """True if this pulse drops a weight."""
    return RELEASE_US < pwm_us <= PULSE_MAX_US
