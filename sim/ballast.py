"""What changes how heavy a vehicle is: a variable buoyancy engine, and weights that it can drop."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, NamedTuple

from hil.schema import Range
from sim.buoyancy import lift_wrench
from sim.forces import Wrench
from sim.matrices import Matrix, cross_matrix, is_positive_definite, product, square, total
from sim.rotations import Rotation
from sim.thruster_model import Point, Pulse
from sim.thrusters import PULSE_MAX_US, PULSE_MIN_US

if TYPE_CHECKING:
    from sim.vehicle import Vehicle

RELEASE_US = 1700  # a pulse above, up to PULSE_MAX_US, lets a weight go

Volume = Annotated[float, Range(0.0, 100.0)]


class BuoyancyEngine(NamedTuple):
    """A bladder at `position` that pumps oil or water: volumes in m³, `rate` in m³/s.

    The vehicle's own volume holds `neutral_volume`, at which the engine lifts nothing; it begins there. A pulse asks
    for a volume: `pwm_neutral_us` for the neutral one, the ends of the range for the least and the most, straight
    lines between. Without a valid pulse (800..2200 us) the volume stays. Not modelled: the mass of what it pumps
    about in the vehicle, its power, weaker pumping at depth, the engine standing out of the water.
    """

    position: Point
    min_volume: Volume
    neutral_volume: Volume
    max_volume: Volume
    rate: Annotated[float, Range(1e-9, 10.0)]
    pwm_neutral_us: Pulse = 1500
    pwm_min_us: Pulse = 1100
    pwm_max_us: Pulse = 1900

    def problem(self) -> str | None:
        """What is wrong between the keys, if anything."""
        if not self.min_volume <= self.neutral_volume <= self.max_volume:
            return "volumes must grow from min_volume over neutral_volume to max_volume"
        if not self.pwm_min_us < self.pwm_neutral_us < self.pwm_max_us:
            return "pulses must grow from pwm_min_us over pwm_neutral_us to pwm_max_us"
        return None

    def volume(self, pwm_us: int) -> float:
        """The volume (m³) that a pulse asks for."""
        offset = pwm_us - self.pwm_neutral_us
        if offset > 0:
            share = min(1.0, offset / (self.pwm_max_us - self.pwm_neutral_us))
            return self.neutral_volume + share * (self.max_volume - self.neutral_volume)
        share = min(1.0, offset / (self.pwm_min_us - self.pwm_neutral_us))
        return self.neutral_volume + share * (self.min_volume - self.neutral_volume)


class Bladder:
    """The lift of a buoyancy engine whose water weighs `specific_weight` N/m³. `volume` m³ is the present one."""

    def __init__(self, engine: BuoyancyEngine, specific_weight: float, dt: float) -> None:
        self._engine = engine
        self._specific_weight = specific_weight
        self._most = engine.rate * dt
        self.volume = engine.neutral_volume

    def step(self, pwm_us: int) -> None:
        """Let it pump for one step."""
        if PULSE_MIN_US <= pwm_us <= PULSE_MAX_US:
            missing = self._engine.volume(pwm_us) - self.volume
            self.volume += max(-self._most, min(self._most, missing))

    def begin(self, time_ns: int) -> None:
        """Nothing changes with time but the volume."""

    def wrench(self, position: Sequence[float], rotation: Rotation, nu_r: Sequence[float]) -> Wrench:
        """Its lift (N, N m, body axes about the origin)."""
        lift = self._specific_weight * (self.volume - self._engine.neutral_volume)
        x, y, z = self._engine.position
        return lift_wrench((lift, lift * x, lift * y, lift * z), rotation)


class DropWeight(NamedTuple):
    """A weight that the vehicle can let go: its mass and volume (m³) are part of the vehicle's, at `position`.

    A pulse above 1700 us on its channel releases it, for good.
    """

    name: str
    mass: Annotated[float, Range(1e-3, 1e5, "kg")]
    position: Point
    volume: Volume = 0.0

    def problem(self) -> str | None:
        """A weight has a name."""
        return None if self.name else "name: give one"


class Release(NamedTuple):
    """The drop weight `name` goes at `time` s of simulated time, whatever the pulses say."""

    name: str
    time: Annotated[float, Range(0.0, 1e7, "s")] = 0.0


def is_release(pwm_us: int) -> bool:
    """True if this pulse lets a weight go."""
    return RELEASE_US < pwm_us <= PULSE_MAX_US


def without(vehicle: "Vehicle", weight: DropWeight, density: float) -> "Vehicle":
    """`vehicle` after it has dropped `weight`, a point mass, in water of `density` kg/m³.

    Mass, volume, both centres and the inertia about the new centre of gravity change; how the water moves along does
    not. A vehicle that was trimmed to weigh nothing is so no more.
    """
    from sim.vehicle import displaced_volume

    volume = displaced_volume(vehicle, density)
    mass, left = vehicle.mass - weight.mass, volume - weight.volume
    centre = _lighter(vehicle.center_of_gravity, vehicle.mass, weight.position, weight.mass)
    about_origin = total(square(vehicle.inertia, 3), _steiner(vehicle.center_of_gravity, vehicle.mass))
    about_origin = total(about_origin, _steiner(weight.position, weight.mass), -1.0)
    inertia = total(about_origin, _steiner(centre, mass), -1.0)
    return vehicle._replace(
        mass=mass,
        volume=left,
        neutrally_buoyant=False,
        center_of_gravity=centre,
        center_of_buoyancy=_lighter(vehicle.center_of_buoyancy, volume, weight.position, weight.volume),
        inertia=tuple([x for row in inertia for x in row]),
    )


def drop_problem(vehicle: "Vehicle") -> str | None:
    """What is wrong with what would be left of `vehicle` without its weights, if anything."""
    for weight in vehicle.drop_weights:
        if weight.mass >= vehicle.mass or weight.volume >= vehicle.volume:
            return f"drop weight {weight.name!r} is more than the vehicle, which it is a part of"
        vehicle = without(vehicle, weight, 1000.0)
        if not is_positive_definite(square(vehicle.inertia, 3)):
            return f"drop weight {weight.name!r} leaves an inertia that is not positive definite"
    return None


def _lighter(centre: Sequence[float], whole: float, place: Sequence[float], part: float) -> Point:
    x, y, z = [(whole * a - part * b) / (whole - part) for a, b in zip(centre, place, strict=True)]
    return x, y, z


def _steiner(place: Sequence[float], mass: float) -> Matrix:
    """The inertia (kg m²) about the origin of a point mass (kg) at `place` (m)."""
    lever = cross_matrix(place)
    return [[-mass * x for x in row] for row in product(lever, lever)]
