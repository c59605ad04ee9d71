"""Thrust allocation: distribute a wrench over the thrusters.

Within the limits this is the least-squares solution of minimum norm, by the pseudo-inverse of the thruster matrix
(Fossen, "Marine Craft Hydrodynamics and Motion Control", on control allocation). The inverse is computed once, by a
singular value decomposition in plain Python, so a vehicle that cannot produce some wrench (six thrusters, no pitch)
needs no special case. Beyond the limits, parts of the wrench are reduced in a fixed order, see `Allocator`.
"""

from collections.abc import Sequence
from math import copysign, sqrt
from operator import gt, lt

from hil.common.errors import ConfigError
from hil.common.vectors import dot

Wrench = tuple[float, float, float, float, float, float]
Matrix = list[list[float]]

# Weights of the errors where not everything is possible: a roll or pitch moment never costs surge, sway, heave or yaw.
AXIS_WEIGHTS = (1.0, 1.0, 1.0, 0.01, 0.01, 1.0)
# The weights after a failure: depth and heading come first, then the way over ground, and the rest rights itself.
FAILED_WEIGHTS = (0.1, 0.1, 1.0, 0.01, 0.01, 1.0)
# Singular values below this share of the largest count as zero; they come from lever arms of some millimetres.
_RANK_TOLERANCE = 1e-4
# Two rows with a cosine below this count as orthogonal; it is a few rounding errors.
_ORTHOGONAL = 1e-14
# Convergence is quadratic: 6 rows take about 5 sweeps.
_MAX_SWEEPS = 30


class Allocator:
    """Distribute a wrench over n thrusters.

    `matrix` has 6 rows (X Y Z K M N along FRD) and n columns: the wrench of 1 N of each thruster, in N and N m.
    `max_forward` and `max_reverse` are n positive limits in N. Raises ConfigError if the sizes differ, a limit is not
    positive or no thruster has an effect.

    If a thruster would exceed its limit, moments are served first, then heave, then the horizontal force. Each of the
    three is scaled as a whole, so a reduced horizontal force keeps its direction. Redundant thrusters are not used to
    avoid saturation.

    `axis_weights` are those of `pseudo_inverse`.
    """

    def __init__(
        self,
        matrix: Sequence[Sequence[float]],
        max_forward: Sequence[float],
        max_reverse: Sequence[float],
        axis_weights: Sequence[float] = AXIS_WEIGHTS,
    ) -> None:
        _check(matrix, max_forward, max_reverse)
        self._given = matrix, max_forward, max_reverse
        self._columns = list(zip(*matrix, strict=True))
        self._forward = list(max_forward)
        self._reverse = [-limit for limit in max_reverse]
        self._inverse, self.rank = pseudo_inverse(matrix, axis_weights)

    def without(self, failed: Sequence[bool]) -> "Allocator":
        """Return the allocator that does not use the `failed` ones of the n thrusters; itself if no other pushes."""
        matrix, forward, reverse = self._given
        left = [[0.0 if gone else value for value, gone in zip(row, failed, strict=True)] for row in matrix]
        pushes = any(value for row in left for value in row)
        return Allocator(left, forward, reverse, FAILED_WEIGHTS) if any(failed) and pushes else self

    def allocate(self, wrench: Sequence[float]) -> tuple[list[float], Wrench]:
        """Return the n thrusts (N) for `wrench` (X Y Z N, K M N N m, along FRD), and the residual wrench."""
        thrusts = self._thrusts(wrench)
        if any(map(gt, thrusts, self._forward)) or any(map(lt, thrusts, self._reverse)):
            thrusts = self._within_limits(wrench)
        return thrusts, self.missing(wrench, thrusts)

    def _thrusts(self, wrench: Sequence[float]) -> list[float]:
        """Return the thrusts for `wrench` without limits."""
        x, y, z, k, m, n = wrench
        # starts with 0.0, so that no thrust is -0.0
        return [0.0 + a * x + b * y + c * z + d * k + e * m + f * n for a, b, c, d, e, f in self._inverse]

    def missing(self, wrench: Sequence[float], thrusts: Sequence[float]) -> Wrench:
        """Return `wrench` minus the wrench of `thrusts`."""
        x, y, z, k, m, n = wrench
        surge = sway = heave = roll = pitch = yaw = 0.0  # not by `sum`, which rounds differently from Python 3.12 on
        for thrust, (a, b, c, d, e, f) in zip(thrusts, self._columns, strict=True):
            surge += a * thrust
            sway += b * thrust
            heave += c * thrust
            roll += d * thrust
            pitch += e * thrust
            yaw += f * thrust
        return x - surge, y - sway, z - heave, k - roll, m - pitch, n - yaw

    def _within_limits(self, wrench: Sequence[float]) -> list[float]:
        x, y, z, k, m, n = wrench
        thrusts = [0.0] * len(self._forward)
        for part in ((0.0, 0.0, 0.0, k, m, n), (0.0, 0.0, z, 0.0, 0.0, 0.0), (x, y, 0.0, 0.0, 0.0, 0.0)):
            self._add_within_limits(thrusts, self._thrusts(part))
        return thrusts

    def _add_within_limits(self, thrusts: list[float], extra: list[float]) -> None:
        """Add the largest share, 0 to 1, of `extra` to `thrusts` that keeps every thruster within its limits."""
        share = 1.0
        for now, more, forward, reverse in zip(thrusts, extra, self._forward, self._reverse, strict=True):
            if now + share * more > forward:
                share = (forward - now) / more
            elif now + share * more < reverse:
                share = (reverse - now) / more
        for index, more in enumerate(extra):
            # the limits here remove only the last bit of rounding
            wanted = thrusts[index] + share * more
            thrusts[index] = min(self._forward[index], max(self._reverse[index], wanted))


def pseudo_inverse(
    matrix: Sequence[Sequence[float]], axis_weights: Sequence[float] = AXIS_WEIGHTS
) -> tuple[Matrix, int]:
    """Return the weighted pseudo-inverse (n rows of 6) of a 6 x n thruster matrix, and the matrix's rank.

    Of all thrusts f with the least error, the sum of (axis weight x error)² over X Y Z K M N, it gives the least
    ones. The weights are six positive numbers: the importance of each axis where not everything is possible. Raises
    ConfigError if the number of weights is wrong or one is not positive.

    With D the diagonal matrix of the weights, it is (D T)+ D (Fossen 2021, section 11.2.2, for full rank). It is
    computed by one-sided Jacobi (Golub & Van Loan 2013, section 8.6): rotations make the rows orthogonal; then each row
    is a singular value times a right singular vector.
    """
    if len(axis_weights) != len(matrix) or not all(weight > 0.0 for weight in axis_weights):
        raise ConfigError(f"thrusters: axis weights must be {len(matrix)} numbers above 0")
    rows = [[weight * value for value in row] for weight, row in zip(axis_weights, matrix, strict=True)]
    size = len(rows)
    basis = [[float(i == j) for j in range(size)] for i in range(size)]
    dust = _RANK_TOLERANCE**2 * sum(dot(row, row) for row in rows)
    for _ in range(_MAX_SWEEPS):
        if not _sweep(rows, basis, dust):
            break
    energies = [dot(row, row) for row in rows]
    least = max(energies) * _RANK_TOLERANCE**2
    strong = [i for i, energy in enumerate(energies) if energy > least]
    inverse = [
        [weight * sum(rows[i][column] * basis[i][axis] / energies[i] for i in strong)
         for axis, weight in enumerate(axis_weights)]
        for column in range(len(matrix[0]))
    ]  # fmt: skip
    return inverse, len(strong)


def _sweep(rows: Matrix, basis: Matrix, dust: float) -> bool:
    """Rotate every pair of rows once; return False if all were orthogonal, except rows weaker than `dust`."""
    rotated = False
    for i in range(len(rows)):
        for j in range(i + 1, len(rows)):
            overlap = dot(rows[i], rows[j])
            lengths = sqrt(dot(rows[i], rows[i]) * dot(rows[j], rows[j]))
            # relative to the pair's own size, or a weak row beside a strong one would not become orthogonal
            if abs(overlap) > _ORTHOGONAL * max(lengths, dust):
                _rotate(rows, basis, i, j, overlap)
                rotated = True
    return rotated


def _rotate(rows: Matrix, basis: Matrix, i: int, j: int, overlap: float) -> None:
    zeta = (dot(rows[j], rows[j]) - dot(rows[i], rows[i])) / (2.0 * overlap)
    tangent = copysign(1.0, zeta) / (abs(zeta) + sqrt(1.0 + zeta * zeta))
    c = 1.0 / sqrt(1.0 + tangent * tangent)
    s = c * tangent
    for table in (rows, basis):
        first, second = table[i], table[j]
        table[i] = [c * a - s * b for a, b in zip(first, second, strict=True)]
        table[j] = [s * a + c * b for a, b in zip(first, second, strict=True)]


def _check(matrix: Sequence[Sequence[float]], forward: Sequence[float], reverse: Sequence[float]) -> None:
    count = len(forward)
    if len(matrix) != 6 or any(len(row) != count for row in matrix) or len(reverse) != count:
        raise ConfigError(f"thrusters: {count} limits need a matrix of 6 rows and {count} columns")
    if not all(limit > 0.0 for limit in (*forward, *reverse)):
        raise ConfigError("thrusters: every thrust limit must be above 0 N")
    if not any(value for row in matrix for value in row):
        raise ConfigError("thrusters: none of them pushes anywhere; give their directions")
