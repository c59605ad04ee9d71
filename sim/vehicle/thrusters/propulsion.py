"""Thrusters with rotor dynamics or with a battery. Vehicles that have neither use `bank.ThrusterSet`."""

from collections.abc import Sequence
from math import exp
from typing import Any

from sim.vehicle.battery import BatteryPack, BatteryState
from sim.vehicle.thrusters.bank import ThrusterSet
from sim.vehicle.thrusters.curves import T200
from sim.vehicle.thrusters.lags import Lag
from sim.vehicle.thrusters.model import Thruster
from sim.vehicle.thrusters.t200 import VOLTS
from sim.vehicle.vehicle import Vehicle


class Propulsion(ThrusterSet):
    """A ThrusterSet in which each thruster has its own dynamics, and the vehicle's battery supplies its T200s.

    The battery is loaded with the steady current at the pulse, not with that of a rotor that still accelerates.
    """

    def __init__(self, vehicle: Vehicle, dt: float, seed: int = 0) -> None:
        super().__init__(vehicle, dt, seed)
        self._lags = [_lag(thruster, dt) for thruster in vehicle.thrusters]
        self._pack = BatteryPack(vehicle.battery) if vehicle.battery else None
        # Indices of the thrusters on the battery, their thrusts (N) and the sum of their currents (A) at each of VOLTS.
        self._powered = [i for i, t in enumerate(vehicle.thrusters) if self._pack and isinstance(t.curve, T200)]
        self._powered_thrusts: list[list[float]] = [[0.0] * len(VOLTS) for _ in self._powered]
        self._amperes = [0.0] * len(VOLTS)

    @property
    def battery(self) -> BatteryState | None:
        """The battery's state; None if there is none."""
        return self._pack.state if self._pack else None

    def motors(self, pwm_us: Sequence[int]) -> list[tuple[float, float]]:
        """Return speed and current of each as ThrusterSet.motors; with rotor dynamics, the speed is the present one."""
        steady = super().motors(pwm_us)
        speeds = [getattr(lag, "speed", speed) for lag, (speed, _) in zip(self._lags, steady, strict=False)]
        return [(speed, current) for speed, (_, current) in zip(speeds, steady, strict=True)]

    def _supply(self, curve: Any) -> float:
        if self._pack is None:
            return super()._supply(curve)
        state = self._pack.state
        return 0.0 if state.cut_off else state.voltage

    def _step_lags(self) -> list[float]:
        if self._pack:
            self._draw_power(self._pack)
        return [lag.step(target) for lag, target in zip(self._lags, self._targets, strict=True)]

    def _draw_power(self, pack: BatteryPack) -> None:
        """Step the battery under the thrusters' load, and set their target thrusts for its voltage."""
        piece, share = pack.step(VOLTS, self._amperes, self._dt)
        for index, thrust in zip(self._powered, self._powered_thrusts, strict=True):
            target = thrust[piece] + share * (thrust[piece + 1] - thrust[piece])
            self._targets[index] = self._thrusters[index].clamp(target)

    def command(self, pwm_us: tuple[int, ...]) -> None:
        """Set the thrusters' commands: see ThrusterSet.command."""
        super().command(pwm_us)
        self._amperes = [0.0] * len(VOLTS)
        for number, index in enumerate(self._powered):
            curve = self._thrusters[index].curve
            assert isinstance(curve, T200)
            self._powered_thrusts[number], amperes, _ = curve.rows(pwm_us[index])
            self._amperes = [a + b for a, b in zip(self._amperes, amperes, strict=True)]


class _FirstOrder:
    """The first-order lag of `time_constant` (s), solved exactly for a pulse that is constant during the step."""

    def __init__(self, time_constant: float, dt: float) -> None:
        self._gain = 1.0 - exp(-dt / time_constant) if time_constant else 1.0
        self._thrust = 0.0

    def step(self, target: float) -> float:
        """Return the thrust in N a step later."""
        self._thrust += self._gain * (target - self._thrust)
        return self._thrust


def _lag(thruster: Thruster, dt: float) -> Lag:
    if thruster.dynamics is None:
        return _FirstOrder(thruster.time_constant, dt)
    return thruster.dynamics.lag(thruster.max_forward, thruster.max_reverse, dt)
