"""Small dense matrices as lists of rows, for setting up a vehicle outside the step."""

from collections.abc import Sequence
from math import sqrt
from typing import Annotated

from hil.common.schema import Range

Matrix = list[list[float]]
# One number of a vehicle's matrices; the largest of 1e6 kg and 50 m is 2.5e9 kg m².
Entry = Annotated[float, Range(-1e10, 1e10)]


def square(values: Sequence[float], size: int) -> Matrix:
    """Return `size` numbers as a diagonal matrix, or `size` x `size` numbers row after row as a full one."""
    if len(values) == size:
        return [[values[i] if i == j else 0.0 for j in range(size)] for i in range(size)]
    return [list(values[i * size : (i + 1) * size]) for i in range(size)]


def times(matrix: Matrix, u: float, v: float, w: float, p: float, q: float, r: float) -> list[float]:
    """Return a 6x6 matrix times (u, v, w, p, q, r), summed in this order, which the C twin repeats."""
    return [a * u + b * v + c * w + d * p + e * q + f * r for a, b, c, d, e, f in matrix]


def cross_matrix(vector: Sequence[float]) -> Matrix:
    """Return S(a), the 3x3 matrix of the cross product: S(a) b = a x b."""
    x, y, z = vector
    return [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]


def product(a: Matrix, b: Matrix) -> Matrix:
    """Return the matrix product a b."""
    columns = list(zip(*b, strict=True))
    return [[sum(x * y for x, y in zip(row, column, strict=True)) for column in columns] for row in a]


def total(a: Matrix, b: Matrix, scale: float = 1.0) -> Matrix:
    """Return a + scale b."""
    return [[x + scale * y for x, y in zip(*rows, strict=True)] for rows in zip(a, b, strict=True)]


def transpose(a: Matrix) -> Matrix:
    """Return the transposed matrix."""
    return [list(column) for column in zip(*a, strict=True)]


def is_symmetric(a: Matrix) -> bool:
    """True if a[i][j] and a[j][i] agree to a millionth of the largest entry."""
    largest = max(abs(x) for row in a for x in row)
    return all(abs(a[i][j] - a[j][i]) <= 1e-6 * largest for i in range(len(a)) for j in range(i))


def is_diagonal(a: Matrix) -> bool:
    """True if all entries off the diagonal are zero."""
    return not any(x for i, row in enumerate(a) for j, x in enumerate(row) if i != j)


def is_positive_definite(a: Matrix) -> bool:
    """True if the symmetric matrix has a Cholesky factor, that is if x'a x > 0 for every x but 0."""
    lower: Matrix = []
    for i, row in enumerate(a):
        lower.append([])
        for j in range(i + 1):
            rest = row[j] - sum(x * y for x, y in zip(lower[i], lower[j], strict=False))
            if i == j and not rest > 0.0:  # written so that it is also true for NaN
                return False
            lower[i].append(sqrt(rest) if i == j else rest / lower[j][j])
    return True


def is_positive_semidefinite(a: Matrix) -> bool:
    """True if x'a x >= 0 for every x, to a billionth of the largest entry.

    The antisymmetric part of `a` is ignored, because it adds nothing to x'a x.
    """
    symmetric = total(a, transpose(a))
    shift = 1e-9 * max(abs(x) for row in symmetric for x in row) or 1.0
    return is_positive_definite(total(symmetric, square([shift] * len(a), len(a))))


def inverse(a: Matrix) -> Matrix:
    """Return the inverse, by Gauss-Jordan elimination with row pivoting. Raises ZeroDivisionError if there is none."""
    size = len(a)
    rows = [[*row, *(float(i == j) for j in range(size))] for i, row in enumerate(a)]
    for column in range(size):
        pivot = max(range(column, size), key=lambda i: abs(rows[i][column]))
        rows[column], rows[pivot] = rows[pivot], rows[column]
        scale = 1.0 / rows[column][column]
        rows[column] = [x * scale for x in rows[column]]
        for i in range(size):
            if i != column:
                factor = rows[i][column]
                rows[i] = [x - factor * y for x, y in zip(rows[i], rows[column], strict=True)]
    return [row[size:] for row in rows]
