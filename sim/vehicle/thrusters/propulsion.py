"""Thrusters with a battery. Vehicles that have none use `bank.ThrusterSet`."""

from typing import Any

from sim.vehicle.battery import BatteryPack, BatteryState
from sim.vehicle.thrusters.bank import ThrusterSet
from sim.vehicle.thrusters.curves import T200
from sim.vehicle.thrusters.t200 import VOLTS
from sim.vehicle.vehicle import Vehicle


class Propulsion(ThrusterSet):
    """A ThrusterSet whose T200s are supplied by the vehicle's battery.

    The battery is loaded with the steady current at the pulse, not with that of a rotor that still accelerates.
    """

    def __init__(self, vehicle: Vehicle, dt: float, seed: int = 0) -> None:
        super().__init__(vehicle, dt, seed)
        assert vehicle.battery is not None, "sim.assembly.make_thrusters checks it"
        self._pack = BatteryPack(vehicle.battery)
        # Indices of the thrusters on the battery, their thrusts (N) and the sum of their currents (A) at each of VOLTS.
        self._powered = [i for i, t in enumerate(vehicle.thrusters) if isinstance(t.curve, T200)]
        self._powered_thrusts: list[list[float]] = [[0.0] * len(VOLTS) for _ in self._powered]
        self._amperes = [0.0] * len(VOLTS)

    @property
    def battery(self) -> BatteryState:
        """The battery's state."""
        return self._pack.state

    def _supply(self, curve: Any) -> float:
        state = self._pack.state
        return 0.0 if state.cut_off else state.voltage

    def _step_lags(self) -> list[float]:
        """Step the battery under the thrusters' load, and the thrusters towards their thrusts at its voltage."""
        piece, share = self._pack.step(VOLTS, self._amperes, self._dt)
        for index, thrust in zip(self._powered, self._powered_thrusts, strict=True):
            target = thrust[piece] + share * (thrust[piece + 1] - thrust[piece])
            self._targets[index] = self._thrusters[index].clamp(target)
        return super()._step_lags()

    def command(self, pwm_us: tuple[int, ...]) -> None:
        """Set the thrusters' commands: see ThrusterSet.command."""
        super().command(pwm_us)
        self._amperes = [0.0] * len(VOLTS)
        for number, index in enumerate(self._powered):
            curve = self._thrusters[index].curve
            assert isinstance(curve, T200)
            self._powered_thrusts[number], amperes, _ = curve.rows(pwm_us[index])
            self._amperes = [a + b for a, b in zip(self._amperes, amperes, strict=True)]
