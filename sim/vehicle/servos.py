"""Actuators with a lag and a limited rate: servos of fins, the pump of a buoyancy engine."""

from collections.abc import Sequence


class Servos:
    """Several servos that start at `values`, in any unit.

    In a step each moves by its gain times its distance from the target, limited to its entry in `limits`.
    """

    def __init__(self, values: Sequence[float], gains: Sequence[float], limits: Sequence[float]) -> None:
        self.values = [float(value) for value in values]
        self._targets = list(self.values)
        self._gains = list(gains)
        self._limits = list(limits)

    def set_targets(self, targets: Sequence[float]) -> None:
        """Set the targets of all following steps."""
        self._targets = list(targets)

    def step(self) -> None:
        """Move all servos by one step."""
        rows = zip(self.values, self._targets, self._gains, self._limits, strict=True)
        self.values = [value + max(-limit, min(limit, gain * (target - value))) for value, target, gain, limit in rows]

    def numbers(self) -> list[float]:
        """Return all numbers that `step` uses, servo after servo, as one flat list, for the C twin."""
        rows = zip(self.values, self._targets, self._gains, self._limits, strict=True)
        return [x for row in rows for x in row]
