"""What a vehicle has beside hull and thrusters: fins, hull lift, cross-flow drag, buoyancy engine, drop weights.

Loaded only for a vehicle whose file has one of these keys:

    [[fins]]               sim/surfaces.py; what all fins share may stand once, in [every_fin]
    [lift], [cross_flow]   sim/body_lift.py, as is forward_speed_damping = [...]
    [buoyancy_engine]      sim/ballast.py, as are
    [[drop_weights]]
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from hil.errors import ConfigError
from hil.schema import parse
from sim.ballast import Bladder, BuoyancyEngine, DropWeight, Release, drop_problem, is_release
from sim.body_lift import CrossFlow, CrossFlowDrag, HullLift, Lift, SpeedDamping
from sim.forces import Force
from sim.surfaces import Fin, FinSet

if TYPE_CHECKING:
    from sim.vehicle import Vehicle


class _Keys(NamedTuple):
    """These keys of a vehicle's file."""

    fins: tuple[Fin, ...] = ()
    lift: Lift | None = None
    cross_flow: CrossFlow | None = None
    buoyancy_engine: BuoyancyEngine | None = None
    drop_weights: tuple[DropWeight, ...] = ()
    forward_speed_damping: tuple[float, ...] = ()

    def problem(self) -> str | None:
        """What is wrong between the keys, if anything."""
        if len(self.forward_speed_damping) not in (0, 6, 36):
            return f"forward_speed_damping needs 6 numbers or 36, found {len(self.forward_speed_damping)}"
        return None


def with_equipment(vehicle: "Vehicle", tables: dict[str, Any], where: str) -> "Vehicle":
    """`vehicle` with what these tables of its file `where` describe. Raises ConfigError."""
    vehicle = vehicle._replace(**parse(tables, _Keys, where)._asdict())
    problem = vehicle.channel_problem() or drop_problem(vehicle)
    if problem:
        raise ConfigError(f"{where}: {problem}")
    return vehicle


class Equipment:
    """The equipment of one vehicle in water of `density` kg/m³ under `gravity` m/s², stepped every `dt` s.

    `forces` is what of it pushes; `fins` and `bladder` are None if there are none; `aboard` the weights not dropped.
    Raises ConfigError for a release of a weight that there is not.
    """

    def __init__(
        self, vehicle: "Vehicle", density: float, gravity: float, dt: float, releases: Sequence[Release] = ()
    ) -> None:
        self.fins = FinSet(vehicle.fins, density, dt) if vehicle.fins else None
        engine = vehicle.buoyancy_engine
        self.bladder = Bladder(engine, density * gravity, dt) if engine else None
        self._weights = vehicle.drop_weights
        self.aboard = {weight.name: weight for weight in self._weights}
        for release in releases:
            self._known(release.name)
        self._releases = sorted(releases, key=lambda release: release.time)
        self.forces = self._forces(vehicle, density)

    def step(self, time_ns: int, pwm_us: Sequence[int]) -> list[DropWeight]:
        """Take the pulses (us) of fins, engine and weights for one step; the weights that go now."""
        count = len(self.fins.angles) if self.fins else 0
        if self.fins:
            self.fins.step(pwm_us[:count])
        if self.bladder:
            self.bladder.step(pwm_us[count])
            count += 1
        going = [weight.name for weight, pulse in zip(self._weights, pwm_us[count:], strict=True) if is_release(pulse)]
        while self._releases and self._releases[0].time * 1e9 <= time_ns:
            going.append(self._releases.pop(0).name)
        return [self.aboard.pop(name) for name in dict.fromkeys(going) if name in self.aboard]

    def take(self, name: str) -> DropWeight:
        """The weight `name`, which is aboard no more. Raises ConfigError if it was not."""
        self._known(name)
        if name not in self.aboard:
            raise ConfigError(f"release: {name!r} has been dropped already")
        return self.aboard.pop(name)

    def _known(self, name: str) -> None:
        names = [weight.name for weight in self._weights]
        if name not in names:
            raise ConfigError(f"release: no drop weight {name!r}; there are: {', '.join(names) or 'none'}")

    def _forces(self, vehicle: "Vehicle", density: float) -> list[Force]:
        forces: list[Force] = []
        if vehicle.lift:
            forces.append(HullLift(vehicle.lift, vehicle.added_mass, density))
        if vehicle.cross_flow:
            forces.append(CrossFlowDrag(vehicle.cross_flow, vehicle.dimensions, density))
        if vehicle.forward_speed_damping:
            forces.append(SpeedDamping(vehicle.forward_speed_damping))
        forces += [force for force in (self.fins, self.bladder) if force is not None]
        return forces
