"""A battery whose voltage falls under load: open-circuit voltage by charge, inner resistance, cut-off."""

from collections.abc import Sequence
from typing import Annotated, NamedTuple

from hil.common.schema import Range
from sim.interpolation import interpolate

Fraction = Annotated[float, Range(0.0, 1.0)]
Volts = Annotated[float, Range(0.1, 1000.0, "V")]


class Battery(NamedTuple):
    """One battery pack.

    `capacity_wh` (Wh) is the energy from full to empty at open-circuit voltage. `open_circuit` (V) are the voltages at
    the charge fractions `charge`, linear in between. `resistance` (ohm) is that of pack and wires, `hotel_current` (A)
    the current of everything except the thrusters, `start` the charge fraction at the start. The pack switches off
    permanently when it is empty, or when its terminal voltage is below `cut_off` (V) for `cut_off_delay` (s) without
    interruption. A shorter voltage sag, as when all thrusters start, does not switch it off. The default delay is that
    of a monitor of such packs (Texas Instruments bq77PL900, data sheet SLUS844B, UVD: 1 s, adjustable from 1 to 8 s).
    Not modelled: heat, ageing, relaxation after a load.
    """

    capacity_wh: Annotated[float, Range(0.01, 1e6, "Wh")]
    charge: tuple[Fraction, ...]
    open_circuit: tuple[Volts, ...]
    resistance: Annotated[float, Range(0.0, 10.0, "ohm")]
    cut_off: Annotated[float, Range(0.0, 1000.0, "V")] = 0.0
    cut_off_delay: Annotated[float, Range(0.0, 600.0, "s")] = 1.0
    hotel_current: Annotated[float, Range(0.0, 1000.0, "A")] = 0.0
    start: Fraction = 1.0

    def validate(self) -> str | None:
        """Return what is wrong with the combination of the keys, or None."""
        if len(self.charge) != len(self.open_circuit) or len(self.charge) < 2:
            return f"{len(self.charge)} charge and {len(self.open_circuit)} open_circuit: as many of each, at least two"
        if self.charge[0] != 0.0 or self.charge[-1] != 1.0:
            return "charge: begins with 0, empty, and ends with 1, full"
        if any(b <= a for a, b in zip(self.charge, self.charge[1:], strict=False)):
            return "charge: each must be greater than the one before"
        if any(b < a for a, b in zip(self.open_circuit, self.open_circuit[1:], strict=False)):
            return "open_circuit: falls where the charge grows"
        return None

    @property
    def capacity_ah(self) -> float:
        """The charge in Ah that makes `capacity_wh` at open-circuit voltage."""
        ends = zip(self.charge, self.charge[1:], self.open_circuit, self.open_circuit[1:], strict=False)
        return self.capacity_wh / sum((b - a) * (low + high) / 2.0 for a, b, low, high in ends)


class BatteryState(NamedTuple):
    """Reading of a battery monitor: volts at the terminals, amperes drawn, fraction left, switched off."""

    voltage: float
    current: float
    fraction: float
    cut_off: bool


class BatteryPack:
    """The state of a battery, stepped with its load."""

    def __init__(self, battery: Battery) -> None:
        self._battery = battery
        self._capacity = battery.capacity_ah
        self._fraction = battery.start
        self._voltage = self.open_circuit
        self._current = 0.0
        self._off = False
        self._undervoltage_s = 0.0  # time below cut_off without interruption

    @property
    def open_circuit(self) -> float:
        """The voltage in V without load, now."""
        return interpolate(self._battery.charge, self._battery.open_circuit, self._fraction)

    @property
    def state(self) -> BatteryState:
        """Present state of the battery."""
        return BatteryState(self._voltage, self._current, self._fraction, self._off)

    def step(self, volts: Sequence[float], amperes: Sequence[float], dt: float) -> tuple[int, float]:
        """Supply a load for `dt` s; return the operating point on its table: index of the piece and share along it.

        The load draws `amperes` at `volts` (from 0 up), linear in between. The voltage V with V + resistance I(V) =
        open circuit lies on one of these pieces and is solved there without iteration. Returns (0, 0) when off.
        """
        if self._off:
            return 0, 0.0
        piece, share = self._solve(volts, amperes)
        self._voltage = volts[piece] + share * (volts[piece + 1] - volts[piece])
        self._current = amperes[piece] + share * (amperes[piece + 1] - amperes[piece]) + self._battery.hotel_current
        if share == 1.0:  # above the last of `volts` the current is constant
            self._voltage = self.open_circuit - self._battery.resistance * self._current
        self._undervoltage_s = self._undervoltage_s + dt if self._voltage < self._battery.cut_off else 0.0
        if self._undervoltage_s > self._battery.cut_off_delay or self._fraction <= 0.0 or self._voltage <= 0.0:
            self._off, self._voltage, self._current = True, self.open_circuit, 0.0
            return 0, 0.0
        self._discharge(dt)
        return piece, share

    def _solve(self, volts: Sequence[float], amperes: Sequence[float]) -> tuple[int, float]:
        resistance = self._battery.resistance
        available = self.open_circuit - resistance * self._battery.hotel_current
        start = 0.0  # V, of the first piece
        for piece in range(len(volts) - 1):
            end = volts[piece + 1] + resistance * amperes[piece + 1]
            if available < end:
                return piece, max(0.0, (available - start) / (end - start))
            start = end
        return len(volts) - 2, 1.0

    def _discharge(self, dt: float) -> None:
        used_ah = self._current * dt / 3600.0
        self._fraction = max(0.0, self._fraction - used_ah / self._capacity)
