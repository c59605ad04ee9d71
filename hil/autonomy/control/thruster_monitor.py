"""Find failed thrusters: compare the thrust that each one reports with the thrust that it was commanded.

A motor controller reports speed and current, which stand for a thrust. A thruster has failed when its report differs
for a second by most of the command: it stands still, has lost its propeller, or turns as it likes. A failed thruster is
tested at intervals with a small thrust, and counts as repaired when it follows.
"""

from collections.abc import Sequence
from math import exp, isfinite

FAILED_SHARE = 0.8  # of the command, by which a failed thruster's report differs; a low battery makes up to 0.6
_FOLLOWS = 0.5  # the share within which a tested thruster follows
_LEAST = 0.003  # share of the greatest thrust; smaller commands are not judged
_TEST = 0.05  # share of the greatest thrust with which a failed thruster is tested
_CONFIRM_S = 1.0
_EVERY_S, _TEST_S = 5.0, 0.8
_SMOOTHING_S = 0.1


class ThrusterMonitor:
    """Monitor of n thrusters with the greatest thrusts `limits` (N) and the lags `time_constants` (s).

    `failed` and `unwatched` (it reports nothing) have one value a thruster, `reported` the thrust of each in N, 0 if it
    is unknown.
    """

    def __init__(self, limits: Sequence[float], time_constants: Sequence[float]) -> None:
        count = len(limits)
        self.failed, self.unwatched = [False] * count, [True] * count
        self.reported = [0.0] * count
        self._limits, self._lags = limits, time_constants
        self._expected, self._smooth = [0.0] * count, [0.0] * count
        self._differs_s, self._failed_s = [0.0] * count, [0.0] * count

    def update(self, commanded: Sequence[float], reported: Sequence[float], dt: float) -> bool:
        """Compare thrusts (N; nan if nothing is reported) `dt` s after the last; return whether `failed` changes."""
        changes = False
        share = 1.0 - exp(-dt / _SMOOTHING_S)
        for i, (wanted, made) in enumerate(zip(commanded, reported, strict=True)):
            self.unwatched[i] = not isfinite(made)
            self.reported[i] = 0.0 if self.unwatched[i] else made
            self._expected[i] += (1.0 - exp(-dt / (self._lags[i] + _SMOOTHING_S))) * (wanted - self._expected[i])
            self._smooth[i] += share * (self.reported[i] - self._smooth[i])
            if self._judge(i, dt):
                self.failed[i] = not self.failed[i]
                self._differs_s[i] = self._failed_s[i] = 0.0
                changes = True
        return changes

    def own_thrusts(self) -> list[float]:
        """Return the thrust (N) of each failed thruster, and 0 for the others."""
        return [made if gone else 0.0 for made, gone in zip(self.reported, self.failed, strict=True)]

    def with_tests(self, thrusts: Sequence[float]) -> list[float]:
        """Return `thrusts` (N) with those of failed thrusters in place of theirs: mostly 0, at times a small one."""
        return [self._test(i) if self.failed[i] else thrust for i, thrust in enumerate(thrusts)]

    def _test(self, index: int) -> float:
        turn, time = divmod(self._failed_s[index], _EVERY_S + _TEST_S)
        thrust = _TEST * self._limits[index] if time >= _EVERY_S else 0.0
        return -thrust if turn % 2.0 else thrust

    def _judge(self, i: int, dt: float) -> bool:
        """Return whether this thruster has failed, or is repaired, from now on."""
        if self.unwatched[i]:
            return self.failed[i]
        expected, differs = self._expected[i], abs(self._smooth[i] - self._expected[i])
        if self.failed[i]:
            self._failed_s[i] += dt
            ends = self._failed_s[i] % (_EVERY_S + _TEST_S) + dt > _EVERY_S + _TEST_S
            return ends and 0.5 * _TEST * self._limits[i] < abs(expected) and differs < _FOLLOWS * abs(expected)
        if differs > FAILED_SHARE * max(abs(expected), _LEAST * self._limits[i]):
            self._differs_s[i] += dt
        else:
            self._differs_s[i] = 0.0
        return self._differs_s[i] > _CONFIRM_S
