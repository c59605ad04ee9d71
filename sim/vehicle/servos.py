"""Actuators that follow pulses with a lag and a limited rate: servos of fins, the pump of a buoyancy engine."""

from collections.abc import Sequence


class Servos:
    """Several servos that start at `values`, in any unit.

    In a step each moves by its gain times its distance from the target, and by no more than its entry in `steps`.
    """

    def __init__(self, values: Sequence[float], gains: Sequence[float], steps: Sequence[float]) -> None:
        self.values = [float(value) for value in values]
        self._targets = list(self.values)
        self._gains = list(gains)
        self._steps = list(steps)

    def aim(self, targets: Sequence[float]) -> None:
        """Set the targets of all following steps."""
        self._targets = list(targets)

    def follow(self) -> None:
        """Move all on by one step."""
        rows = zip(self.values, self._targets, self._gains, self._steps, strict=True)
        self.values = [value + max(-most, min(most, gain * (target - value))) for value, target, gain, most in rows]

    def numbers(self) -> list[float]:
        """Return all that `follow` uses, servo after servo: what the C twin is made of."""
        rows = zip(self.values, self._targets, self._gains, self._steps, strict=True)
        return [x for row in rows for x in row]
