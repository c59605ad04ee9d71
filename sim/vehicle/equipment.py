"""Equipment of a vehicle besides hull and thrusters: fins, hull lift, cross-flow drag, buoyancy engine, drop weights.

This module is loaded only for a vehicle whose file has one of these keys:

    [[fins]]               sim/vehicle/fins.py; keys that all fins share may be given once, in [every_fin]
    [lift], [cross_flow]   sim/vehicle/body_lift.py, as are forward_speed_damping = [...] and [fading_damping]
    [buoyancy_engine]      sim/vehicle/ballast.py, as are
    [[drop_weights]]
    [[thrusters]] azimuth  sim/vehicle/thrusters/azimuth.py
"""

from collections.abc import Sequence

from hil.common.errors import ConfigError
from sim.forces import Force
from sim.vehicle.ballast import Bladder, DropWeight, Release, is_release
from sim.vehicle.body_lift import CrossFlowDrag, HullLift, SlowDamping, SpeedDamping
from sim.vehicle.fins import FinSet
from sim.vehicle.thrusters.azimuth import AzimuthSet
from sim.vehicle.vehicle import Vehicle


class Equipment:
    """The equipment of one vehicle in water of `density` kg/m³ under `gravity` m/s², stepped every `dt` s.

    `forces` are the forces of the equipment; `fins`, `azimuths` and `bladder` are None if there are none;
    `weights_aboard` are the weights not yet dropped, by name. Raises ConfigError for the release of an unknown weight.
    """

    def __init__(
        self, vehicle: Vehicle, density: float, gravity: float, dt: float, releases: Sequence[Release] = ()
    ) -> None:
        self._fins = vehicle.fins
        self.fins = FinSet(vehicle.fins, density, dt) if vehicle.fins else None
        self.azimuths = AzimuthSet(vehicle.thrusters, dt) if vehicle.azimuths else None
        engine = vehicle.buoyancy_engine
        self.bladder = Bladder(engine, density * gravity, dt) if engine else None
        self._weights = vehicle.drop_weights
        self.weights_aboard = {weight.name: weight for weight in self._weights}
        for release in releases:
            self._require_weight(release.name)
        self._releases = sorted(releases, key=lambda release: release.time)
        self.forces = self._forces(vehicle, density)

    def step(self, time_ns: int, pwm_us: Sequence[int]) -> list[DropWeight]:
        """Do one step under the pulses (us) of fins, engine and weights; return the weights that are dropped now."""
        dropped = self.command(tuple(pwm_us))
        for actuator in (self.fins, self.azimuths, self.bladder):
            if actuator:
                actuator.servos.step()
        while self._releases and self._releases[0].time * 1e9 <= time_ns:
            weight = self.weights_aboard.pop(self._releases.pop(0).name, None)
            dropped += [weight] if weight else []
        return dropped

    def command(self, pwm_us: tuple[int, ...]) -> list[DropWeight]:
        """Set the targets of fins and engine to these pulses (us); return the weights that they drop."""
        count = len(self._fins)
        if self.fins:
            self.fins.command(pwm_us[:count])
        if self.azimuths:
            end = count + len(self.azimuths.angles)
            self.azimuths.command(pwm_us[count:end])
            count = end
        if self.bladder:
            self.bladder.command(pwm_us[count])
            count += 1
        names = [weight.name for weight, pulse in zip(self._weights, pwm_us[count:], strict=True) if is_release(pulse)]
        return [self.weights_aboard.pop(name) for name in names if name in self.weights_aboard]

    @property
    def angles(self) -> list[float]:
        """The present angles (rad) of fins, then of azimuth thrusters."""
        return [angle for part in (self.fins, self.azimuths) if part for angle in part.angles]

    @property
    def is_timed(self) -> bool:
        """True if a weight will be dropped at a set time."""
        return bool(self._releases)

    def remove_weight(self, name: str) -> DropWeight:
        """Remove the weight `name` and return it. Raises ConfigError if it is not aboard."""
        self._require_weight(name)
        if name not in self.weights_aboard:
            raise ConfigError(f"release: {name!r} has been dropped already")
        return self.weights_aboard.pop(name)

    def _require_weight(self, name: str) -> None:
        names = [weight.name for weight in self._weights]
        if name not in names:
            raise ConfigError(f"release: no drop weight {name!r}; there are: {', '.join(names) or 'none'}")

    def _forces(self, vehicle: Vehicle, density: float) -> list[Force]:
        forces: list[Force] = []
        if vehicle.lift:
            forces.append(HullLift(vehicle.lift, density))
        if vehicle.cross_flow:
            forces.append(CrossFlowDrag(vehicle.cross_flow, vehicle.dimensions, density))
        if vehicle.forward_speed_damping:
            forces.append(SpeedDamping(vehicle.forward_speed_damping))
        if vehicle.fading_damping:
            forces.append(SlowDamping(vehicle.fading_damping))
        forces += [force for force in (self.fins, self.azimuths, self.bladder) if force is not None]
        return forces
